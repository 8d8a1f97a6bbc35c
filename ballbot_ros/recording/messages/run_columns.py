"""The messages of many ticks of a compiled run, made at once."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from ballbot_ros.controllers.document.axis import PlaneValues
from ballbot_ros.controllers.document.program import ControlProgram, ProgramState
from ballbot_ros.engine.compiled_loop import TickColumns
from ballbot_ros.engine.rows import Rows, columns_of, state_of
from ballbot_ros.parameters import ParameterSet
from ballbot_ros.parameters.timing import BATTERY_PERIOD_NS, TICK_NS
from ballbot_ros.recording.messages.conversions import (
    encode_body,
    encode_clock,
    encode_controller_states,
    encode_duty,
    encode_log,
    encode_motors,
    encode_odometry,
    encode_sticks,
    encode_text,
    encode_tone,
    encode_voltage,
    encode_wall_hit,
)
from ballbot_ros.recording.messages.devices import DEVICE_MESSAGES
from ballbot_ros.recording.messages.raw import Messages, Stamps
from ballbot_ros.recording.messages.run_messages import RunMessages
from ballbot_ros.recording.messages.topics import (
    BATTERY_STATE,
    BLUETOOTH_TX,
    CLOCK,
    CONTROLLER_STATE,
    GAMEPAD_JOY,
    LCD,
    MOTOR_DUTY,
    OPERATING_STATE,
    PLANT_IMU,
    PLANT_JOINT_STATES,
    PLANT_ODOM,
    SCENARIO,
    SOUND,
    WALL_HIT,
    Topic,
)
from ballbot_ros.robot.brick.brick import NO_SAMPLE, NUMBERS_OF, Inputs
from ballbot_ros.robot.plant.ground_truth import GroundTruth

SendAll = Callable[[Stamps, Messages | Sequence[bytes]], None]
"""Sends messages of a topic: their stamps [ns], and the messages as CDR."""


class RunColumns:
    """Creates the messages of many ticks at once, topic by topic: those of :class:`RunMessages`.

    Parameters
    ----------
    messages : RunMessages
        Creates the messages before and after these ticks.
    make : callable
        Returns the function that sends the messages of a topic.
    """

    def __init__(
        self, messages: RunMessages, make: Callable[[Topic], SendAll], parameters: ParameterSet
    ) -> None:
        self._plant, self._controller = messages.plant, messages.controller
        self._make = make
        self._devices = [
            (each.device, each.encoder(parameters.of(each.device.parameters)), each.sample)
            for each in DEVICE_MESSAGES
        ]

    def ticks(self, columns: TickColumns, program: ControlProgram, source: str = SCENARIO) -> None:
        """Create the messages of ticks; `source` names the input in command."""
        stamps = np.asarray(columns.truth.stamp_ns)
        self._truth(columns.truth, stamps, columns.wall_hit)
        self._inputs(columns.inputs, stamps, source)
        self._outputs(columns.program, stamps, program)

    def _send(self, topic: Topic, stamps: Stamps, messages: object) -> None:
        self._make(topic)(stamps, cast('Messages | list[bytes]', messages))

    def _truth(self, truth: GroundTruth, stamps: Stamps, wall_hit: NDArray[np.bool_]) -> None:
        self._send(CLOCK, stamps, encode_clock(truth.stamp_ns))
        due = stamps % BATTERY_PERIOD_NS == 0
        columns: Any = stamps[due], np.asarray(truth.battery_voltage)[due]
        self._send(BATTERY_STATE, stamps[due], encode_voltage(*columns))
        self._send(PLANT_IMU, stamps, encode_body(truth))
        self._send(PLANT_JOINT_STATES, stamps, encode_motors(truth))
        self._send(PLANT_ODOM, stamps, encode_odometry(truth, self._plant.ball_radius))
        before = np.concatenate([[self._plant.wall_hit], wall_hit[:-1]])
        changes = np.flatnonzero(wall_hit != before)
        hits = [encode_wall_hit(wall_hit=bool(wall_hit[each])) for each in changes]
        self._send(WALL_HIT, stamps[changes], hits)
        self._plant.wall_hit = bool(wall_hit[-1])

    def _inputs(self, inputs: Inputs, stamps: Stamps, source: str) -> None:
        for device, encode, topic in self._devices:
            columns = [np.asarray(getattr(inputs, name)) for name in NUMBERS_OF[device.field]]
            due = columns[0] != NO_SAMPLE
            at, readings = stamps[due], [each[due] for each in columns]
            if device.period_ns == TICK_NS:
                self._send(topic, at, encode(at, readings))
            else:
                (reading,) = readings
                self._send(topic, at, [encode(*each) for each in _pairs(at, reading)])
        vertical, horizontal = np.asarray(inputs.vertical), np.asarray(inputs.horizontal)
        due = vertical != NO_SAMPLE
        at, sticks = stamps[due], (vertical[due], horizontal[due])
        self._send(GAMEPAD_JOY, at, encode_sticks(at, sticks, source))

    def _outputs(self, rows: Rows, stamps: Stamps, program: ControlProgram) -> None:
        states = columns_of(ProgramState, rows)
        self._operating_states(rows, stamps, program)
        has_event = states.has_logged | states.has_started_tone | states.has_drawn
        has_event |= states.distance_tone_hz > 0
        for at in np.flatnonzero(has_event):
            outputs = program.outputs_of(state_of(ProgramState, rows[at]))
            now = stamps[at : at + 1]
            for packet in outputs.log:
                self._send(BLUETOOTH_TX, now, [encode_log(packet)])
            for tone in outputs.tones:
                self._send(SOUND, now, [encode_tone(int(now[0]), tone)])
            for page in outputs.pages:
                self._send(LCD, now, [encode_text(page)])
        columns: Any = stamps, (states.duty_x, states.duty_y)
        self._send(MOTOR_DUTY, stamps, encode_duty(*columns))
        x = PlaneValues(*states.x, *states.estimates_x)
        y = PlaneValues(*states.y, *states.estimates_y)
        self._send(CONTROLLER_STATE, stamps, encode_controller_states(stamps, x, y))

    def _operating_states(self, rows: Rows, stamps: Stamps, program: ControlProgram) -> None:
        deciding = rows[['control_mode', 'flag_avoid', 'flag_auto']]
        changes = [0, *(np.flatnonzero(deciding[1:] != deciding[:-1]) + 1).tolist()]
        for at in changes:
            state = program.operating_state_of(state_of(ProgramState, rows[at])).value
            if state != self._controller.operating_state:
                self._controller.operating_state = state
                self._send(OPERATING_STATE, stamps[at : at + 1], [encode_text(state)])


def _pairs(one: NDArray[Any], other: NDArray[Any]) -> Iterator[tuple[Any, Any]]:
    """Return the pairs of both columns, as plain numbers."""
    return zip(one.tolist(), other.tolist(), strict=True)
