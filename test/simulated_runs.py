"""Runs of studies by the compiled and by the ordinary loop."""

import numpy as np

from ballbot_ros.engine.scenario.metrics import METRICS
from ballbot_ros.engine.scenario.scenario import Measure
from ballbot_ros.lab.studies.runs import CompiledSimulator, simulator_for
from ballbot_ros.run.requirements import Processes
from ballbot_ros.run.spec import RunOptions, RunSpec

EVERYTHING = [
    *map(Measure, METRICS),
    Measure('peak_position_m', 1.5, 2.5),
    Measure('peak_pitch_deg', 9.0),
]


def spec_of(name, *assignments, controller=None):
    options = RunOptions(
        processes=Processes.NONE, record=False, controller=controller,
        assignments=('plant_sim.duration=3', *assignments),
    )  # fmt: skip
    return RunSpec.of_scenario(name, options)


def compiled_simulator(spec, measures):
    made = simulator_for(spec, measures)
    assert isinstance(made, CompiledSimulator)
    return made


def assert_same(one, other):
    for name in ('duty_sha256', 'ticks', 'failed', 'fallen'):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name))
    np.testing.assert_allclose(one.measured, other.measured, rtol=1e-9, atol=1e-12)
