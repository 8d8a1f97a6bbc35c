"""The simulated twin of a real robot: what its log tells of it, and its sticks."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np

from ballbot_ros.analysis.run_data import RunData
from ballbot_ros.controllers.codegen.implementation import compose_controller
from ballbot_ros.engine.scenario.scenario import Scenario, StickSignal
from ballbot_ros.engine.scenario.writer import scenario_data
from ballbot_ros.parameters import CONTROLLER, PLANT, ControllerParameters, ParameterSet
from ballbot_ros.parameters.timing import SECOND_NS, SLOW_PERIOD_NS, TICK_S
from ballbot_ros.parameters.yaml_document import yaml_text
from ballbot_ros.recording.messages.topics import GAMEPAD_JOY
from ballbot_ros.run.branch import held_sticks
from ballbot_ros.run.requirements import Processes
from ballbot_ros.run.spec import RunSpec

NAME = 'twin'
"""Name of the recording."""


def twin_spec(
    real: RunData, profile: ParameterSet, identified: ParameterSet, output: Path
) -> RunSpec:
    """Return the run of a twin: the program of the real robot, on a robot like it.

    Its sticks move as long after its calibration as those of the real one after the first packet.

    What is known of the robot and its devices is `identified`; the rest is as in the profile. It
    raises BallbotError if the values do not fit together.
    """
    parameters = ParameterSet(profile)
    for node, name, value in real.attached.parameters:
        if node == CONTROLLER and real.attached.has_parameters:
            parameters.set(CONTROLLER, name, value)
    parameters.update(identified)
    program = parameters.of(ControllerParameters)
    # The first packet comes with the first tick of control, which follows a job of task_ts3.
    begins_ms = program.ts3_period * math.ceil(program.time_start / program.ts3_period)
    begins = begins_ms * 1e-3 + TICK_S
    duration, purpose = begins + real.end, f'does what the sticks of {real.name} say'
    parameters.set(PLANT, 'duration', duration)
    parameters.set(PLANT, 'real_time_factor', 0.0)
    vertical, horizontal = _sticks(real, begins)
    text = yaml_text({'purpose': purpose, 'duration': duration})
    scenario = Scenario(NAME, purpose, vertical=vertical, horizontal=horizontal, text=text)
    scenario = replace(scenario, text=yaml_text(scenario_data(scenario)))
    controller = compose_controller(parameters)
    return RunSpec(scenario, parameters, Processes.NONE, output, controller=controller)


def _sticks(real: RunData, begins: float) -> tuple[StickSignal, StickSignal]:
    """Return the sticks that were sent, later by a time [s]; neutral ones of a CSV."""
    series = real.series.get(GAMEPAD_JOY)
    if series is None:
        return StickSignal(()), StickSignal(())
    count = round(real.end * SECOND_NS) // SLOW_PERIOD_NS
    stamps = real.start_ns + SLOW_PERIOD_NS * np.arange(count)
    values = np.nan_to_num(series.held(stamps)) * 100.0
    first_ns = -(-round(begins * SECOND_NS) // SLOW_PERIOD_NS) * SLOW_PERIOD_NS
    times_ns = first_ns + SLOW_PERIOD_NS * np.arange(count)
    vertical, horizontal = (
        StickSignal(tuple(held_sticks(list(zip(times_ns.tolist(), column, strict=True)), 0.0)))
        for column in np.rint(values * (-1.0, 1.0)).astype(int).T.tolist()
    )
    return vertical, horizontal
