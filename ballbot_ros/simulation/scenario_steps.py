"""What the devices give in a scenario's run, for feeding another control program."""

from __future__ import annotations

from collections.abc import Iterator

from ballbot_ros.codegen.steps import Step
from ballbot_ros.parameters import ParameterSet, PlantParameters
from ballbot_ros.scenario.scenario import Scenario
from ballbot_ros.simulation.closed_loop import ClosedLoop
from ballbot_ros.simulation.timing import FIRST_TICK_NS, MILLISECOND_NS, SECOND_NS, TICK_NS


def scenario_steps(parameters: ParameterSet, scenario: Scenario) -> Iterator[Step]:
    """Yield the device inputs of every tick of a scenario."""
    loop = ClosedLoop(parameters, scenario)
    ticks = round(parameters.of(PlantParameters).duration * SECOND_NS) // TICK_NS
    for _ in range(ticks):
        tick = loop.tick()
        now = tick.truth.stamp_ns
        yield Step((now - FIRST_TICK_NS) // MILLISECOND_NS, now // MILLISECOND_NS, tick.inputs)
