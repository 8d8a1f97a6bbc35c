"""Runs of the controllers that ship, without a graph."""

import numpy as np

from ballbot_ros.engine.closed_loop import ClosedLoop
from ballbot_ros.engine.scenario.scenario import Scenario
from ballbot_ros.run.execution import execute
from ballbot_ros.run.requirements import Processes
from ballbot_ros.run.spec import RunOptions, RunSpec


def run_shipped(controller, scenario='stationary', **options):
    """Run a scenario with a shipped controller, or the document's; return the result."""
    return execute(_spec(controller, scenario, **options))


def duties(controller, *assignments, ticks=750, sticks=None, **options):
    """Return the duties of the planes, shape (ticks, 2), of a robot with a stick signal."""
    spec = _spec(controller, 'stationary', assignments=assignments, **options)
    loop = ClosedLoop(spec.parameters, sticks or Scenario())
    return np.array([loop.tick().outputs.duty for _ in range(ticks)]), loop


def exchanged(controller):
    """Return whether exchanging the planes exchanges the duties, and inverting one inverts them."""
    x, _ = duties(controller, 'plant_sim.start_pitch_x=0.05')
    y, _ = duties(controller, 'plant_sim.start_pitch_x=0', 'plant_sim.start_pitch_y=0.05')
    inverse, _ = duties(controller, 'plant_sim.start_pitch_x=-0.05')
    return (x == y[:, ::-1]).all() and (x == -inverse).all() and x.any()


def _spec(controller, scenario, **options):
    return RunSpec.of_scenario(
        scenario,
        RunOptions(processes=Processes.NONE, record=False, controller=controller, **options),
    )
