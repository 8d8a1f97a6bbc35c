"""Device inputs for testing another control program: scenarios and random sequences."""

from __future__ import annotations

from collections.abc import Iterator

from ballbot_ros.controllers.codegen.folder_check import (
    InputSequence,
    ProgramInput,
    path_steps,
    random_steps,
)
from ballbot_ros.controllers.codegen.programs import program_of
from ballbot_ros.controllers.document.axis import TS1_MS
from ballbot_ros.engine.closed_loop import ClosedLoop
from ballbot_ros.engine.scenario.reader import load_scenario, scenario_names
from ballbot_ros.engine.scenario.scenario import Scenario
from ballbot_ros.parameters import ControllerParameters, ParameterSet, PlantParameters
from ballbot_ros.parameters.timing import FIRST_TICK_NS, MILLISECOND_NS

RANDOM_SEQUENCES = 50
RANDOM_TICKS = 150
"""Length of a random sequence after calibration."""

MEASURED_SEQUENCES = 3
"""The last ones, which together take all paths; the others only compare the programs."""


def scenario_steps(parameters: ParameterSet, scenario: Scenario) -> Iterator[ProgramInput]:
    """Yield the device inputs of every tick of a scenario."""
    loop = ClosedLoop(parameters, scenario)
    for tick in loop.ticks(parameters.of(PlantParameters).duration):
        now = tick.truth.stamp_ns
        yield ProgramInput(
            (now - FIRST_TICK_NS) // MILLISECOND_NS, now // MILLISECOND_NS, tick.inputs
        )


def check_sequences(parameters: ParameterSet) -> list[InputSequence]:
    """Return the inputs of a check with these parameters.

    For the document's program they are those of every shipped scenario, random sequences, and one
    through all modes; for another one, a random sequence that lasts until its end.
    """
    controller = parameters.of(ControllerParameters)
    duration = program_of(controller).duration
    if duration:
        ticks = duration(controller) + RANDOM_TICKS
        steps = list(random_steps(0, ticks, out_of_range=True))
        return [InputSequence('sequence to the end', steps)]
    sequences = []
    for name in scenario_names():
        scenario = load_scenario(name)
        together = ParameterSet(scenario.parameters)
        together.update(parameters)
        sequences.append(InputSequence(name, list(scenario_steps(together, scenario))))
    calibration = int(controller.time_start) // TS1_MS
    ticks = min(calibration, 2500) + RANDOM_TICKS
    for seed in range(RANDOM_SEQUENCES):
        steps = list(random_steps(seed, ticks, out_of_range=seed % 2 == 1))
        sequences.append(InputSequence(f'random sequence {seed}', steps))
    sequences.append(InputSequence('sequence through all modes', list(path_steps(controller))))
    return sequences
