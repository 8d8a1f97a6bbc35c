"""The messages of many ticks of a compiled run, made at once."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from ballbot_ros.controllers.document.axis import PlaneValues
from ballbot_ros.controllers.document.program import ControlProgram, ProgramState
from ballbot_ros.controllers.interface import Program
from ballbot_ros.engine.brick_tasks import BrickTasks
from ballbot_ros.engine.compiled_loop import TickColumns
from ballbot_ros.engine.rows import columns_of, state_of
from ballbot_ros.parameters import ControllerParameters, ParameterSet
from ballbot_ros.parameters.timing import BATTERY_PERIOD_NS, TICK_NS
from ballbot_ros.recording.messages.conversions import (
    encode_battery,
    encode_body,
    encode_clock,
    encode_controller_states,
    encode_duty,
    encode_motors,
    encode_odometry,
    encode_sticks,
)
from ballbot_ros.recording.messages.devices import DEVICE_MESSAGES
from ballbot_ros.recording.messages.raw import Messages, Stamps
from ballbot_ros.recording.messages.run_messages import MakeSend, RunMessages
from ballbot_ros.recording.messages.topics import (
    BATTERY_STATE,
    CLOCK,
    CONTROLLER_STATE,
    GAMEPAD_JOY,
    MOTOR_DUTY,
    PLANT_IMU,
    PLANT_JOINT_STATES,
    PLANT_ODOM,
    SCENARIO,
    Topic,
)
from ballbot_ros.robot.brick.brick import NO_SAMPLE, NUMBERS_OF, Inputs, from_numbers
from ballbot_ros.robot.brick.kernel import Job
from ballbot_ros.robot.plant.ground_truth import GroundTruth

SendAll = Callable[[Stamps, Messages], None]
"""Sends messages of a topic that have the same length, and their stamps [ns]."""


class RunColumns:
    """Creates the messages of many ticks at once, topic by topic: those of :class:`RunMessages`.

    Parameters
    ----------
    messages : RunMessages
        Creates the messages before and after these ticks.
    make : MakeSend
        As for them.
    make_all : callable
        Returns the function that sends many messages of a topic.
    """

    def __init__(
        self,
        messages: RunMessages,
        make: MakeSend,
        make_all: Callable[[Topic], SendAll],
        parameters: ParameterSet,
    ) -> None:
        self._plant, self._controller = messages.plant, messages.controller
        self._make, self._make_all = make, make_all
        self._tasks = BrickTasks(parameters.of(ControllerParameters))
        self._devices = [
            (each.device, each.encoder(parameters.of(each.device.parameters)), each.sample)
            for each in DEVICE_MESSAGES
        ]

    def ticks(self, columns: TickColumns, program: Program, source: str = SCENARIO) -> None:
        """Create the messages of ticks; `source` names the input in command.

        A program other than the document's makes the ticks, too, to publish what it does in them.
        """
        stamps = np.asarray(columns.truth.stamp_ns)
        self._truth(columns.truth, stamps, columns.wall_hit)
        self._inputs(columns.inputs, stamps, source)
        if isinstance(program, ControlProgram):
            self._outputs(columns, stamps, program)
        else:
            self._repeat(columns.inputs, stamps, program)

    def _send(self, topic: Topic, stamps: Stamps, messages: object) -> None:
        self._make_all(topic)(stamps, cast('Messages', messages))

    def _truth(self, truth: GroundTruth, stamps: Stamps, wall_hit: NDArray[np.bool_]) -> None:
        self._send(CLOCK, stamps, encode_clock(truth.stamp_ns))
        due = stamps % BATTERY_PERIOD_NS == 0
        columns: Any = stamps[due], np.asarray(truth.battery_voltage)[due]
        self._send(BATTERY_STATE, stamps[due], encode_battery(*columns))
        self._send(PLANT_IMU, stamps, encode_body(truth))
        self._send(PLANT_JOINT_STATES, stamps, encode_motors(truth))
        self._send(PLANT_ODOM, stamps, encode_odometry(truth, self._plant.ball_radius))
        before = np.concatenate([[self._plant.wall_hit], wall_hit[:-1]])
        for at in np.flatnonzero(wall_hit != before):
            self._plant.set_wall_hit(int(stamps[at]), wall_hit=bool(wall_hit[at]))

    def _inputs(self, inputs: Inputs, stamps: Stamps, source: str) -> None:
        for device, encode, topic in self._devices:
            columns = [np.asarray(getattr(inputs, name)) for name in NUMBERS_OF[device.field]]
            due = columns[0] != NO_SAMPLE
            at, readings = stamps[due], [each[due] for each in columns]
            if device.period_ns == TICK_NS:
                self._send(topic, at, encode(at, readings))
                continue
            send, rows = self._make(topic), zip(*(each.tolist() for each in readings), strict=True)
            for stamp_ns, row in zip(at.tolist(), rows, strict=True):
                send(stamp_ns, encode(stamp_ns, row if len(row) > 1 else row[0]))
        vertical, horizontal = np.asarray(inputs.vertical), np.asarray(inputs.horizontal)
        due = vertical != NO_SAMPLE
        at, sticks = stamps[due], (vertical[due], horizontal[due])
        self._send(GAMEPAD_JOY, at, encode_sticks(at, sticks, source))

    def _repeat(self, columns: Inputs, stamps: Stamps, program: Program) -> None:
        rows = zip(*(np.asarray(each).tolist() for each in columns), strict=True)
        for now_ns, row in zip(stamps.tolist(), rows, strict=True):
            outputs = self._tasks.tick(program, now_ns, from_numbers(Inputs(*row)))
            self._controller.tick(now_ns, outputs, program)

    def _outputs(self, columns: TickColumns, stamps: Stamps, program: ControlProgram) -> None:
        rows = columns.program
        states = columns_of(ProgramState, rows)
        deciding = rows[['control_mode', 'flag_avoid', 'flag_auto']]
        has_event = np.append(True, deciding[1:] != deciding[:-1])
        has_event |= states.has_logged | states.has_started_tone | states.has_drawn
        has_event |= states.distance_tone_hz > 0
        for at in np.flatnonzero(has_event):
            state = state_of(ProgramState, rows[at])
            outputs, operating_state = program.outputs_of(state), program.operating_state_of(state)
            self._controller.events(int(stamps[at]), outputs, operating_state)
        duties: Any = stamps, tuple(columns.duty.T), columns.delay_ns
        self._send(MOTOR_DUTY, stamps, encode_duty(*duties))
        x = PlaneValues(*states.x, *states.estimates_x)
        y = PlaneValues(*states.y, *states.estimates_y)
        self._send(CONTROLLER_STATE, stamps, encode_controller_states(stamps, x, y))
        if self._tasks.is_timed:
            for now_ns, rows in zip(stamps.tolist(), columns.jobs.tolist(), strict=True):
                jobs = [Job.of(program.tasks, numbers) for numbers in rows if any(numbers)]
                self._controller.jobs(now_ns, jobs, program)
