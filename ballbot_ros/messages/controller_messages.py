"""The controller's messages, for the graph and for recordings without one."""

from __future__ import annotations

from collections.abc import Mapping

from ballbot_ros.brick.brick import DeviceOutputs
from ballbot_ros.controllers.interface import Program
from ballbot_ros.messages.conversions import (
    encode_controller_state,
    encode_duty,
    encode_log,
    encode_text,
    encode_tone,
)
from ballbot_ros.messages.motor_stop import encode_stop
from ballbot_ros.messages.outputs import MakeSend
from ballbot_ros.messages.parameter_events import encode_parameter_event
from ballbot_ros.messages.topics import (
    BLUETOOTH_TX,
    CONTROLLER_STATE,
    LCD,
    MOTOR_DUTY,
    OPERATING_STATE,
    PARAMETER_EVENTS,
    SOUND,
)
from ballbot_ros.parameters import Value
from ballbot_ros.timing import TICK_NS


class ControllerMessages:
    """Encodes and sends the controller's messages.

    `operating_state` is the last one sent, '' before the first tick.
    """

    def __init__(self, make: MakeSend) -> None:
        self.operating_state = ''
        self._duty = self._state = b''
        self._send_duty = make(MOTOR_DUTY)
        self._send_state = make(CONTROLLER_STATE)
        self._send_operating_state = make(OPERATING_STATE)
        self._send_log = make(BLUETOOTH_TX)
        self._send_sound = make(SOUND)
        self._send_lcd = make(LCD)
        self._send_event = make(PARAMETER_EVENTS)

    def tick(self, now_ns: int, outputs: DeviceOutputs, program: Program) -> None:
        """Send the results of a tick at `now_ns` [ns]."""
        # Messages without a stamp go first, so that no reader sees them after the next tick.
        if program.operating_state != self.operating_state:
            self.operating_state = program.operating_state.value
            self._send_operating_state(now_ns, encode_text(self.operating_state))
        for packet in outputs.log:
            self._send_log(now_ns, encode_log(packet))
        for tone in outputs.tones:
            self._send_sound(now_ns, encode_tone(now_ns, tone))
        for page in outputs.pages:
            self._send_lcd(now_ns, encode_text(page))
        self._duty = encode_duty(now_ns, outputs.duty)
        self._state = encode_controller_state(now_ns, program.x, program.y)
        self.resend(now_ns)

    def retuned(self, now_ns: int, values: Mapping[str, Value]) -> None:
        """Send that parameters have other values from the tick at `now_ns` [ns] on."""
        self._send_event(now_ns, encode_parameter_event(now_ns, values))

    def begin(self) -> None:
        """Begin a run: its first operating state counts as a change."""
        self.operating_state = ''

    def resend(self, stamp_ns: int) -> None:
        """Send the periodic messages of the newest tick, which have the stamp `stamp_ns`."""
        self._send_duty(stamp_ns, self._duty)
        self._send_state(stamp_ns, self._state)

    def stop_motors(self, last_ns: int) -> None:
        """Publish that the motors are off from the tick after the last one."""
        stamp_ns = last_ns + TICK_NS
        self._send_duty(stamp_ns, encode_stop(stamp_ns))
