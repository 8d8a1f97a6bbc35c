"""The controller's messages, for the graph and for recordings without one."""

from __future__ import annotations

from ballbot_ros.brick.brick import DeviceOutputs
from ballbot_ros.controller.interface import Program
from ballbot_ros.messages.conversions import (
    fill_controller_state,
    fill_duty,
    fill_log,
    fill_tone,
)
from ballbot_ros.messages.motor_stop import send_stop
from ballbot_ros.messages.outputs import MakeOutput
from ballbot_ros.messages.topics import (
    BLUETOOTH_TX,
    CONTROLLER_STATE,
    LCD,
    MOTOR_DUTY,
    OPERATING_STATE,
    SOUND,
)


class ControllerMessages:
    """Fills and sends the controller's messages.

    Parameters
    ----------
    make : callable
        Creates the output of a topic.

    Attributes
    ----------
    operating_state : str
        The last state sent; '' before the first tick.
    """

    def __init__(self, make: MakeOutput) -> None:
        self.operating_state = ''
        self._duty = make(MOTOR_DUTY)
        self._state = make(CONTROLLER_STATE)
        self._operating_state = make(OPERATING_STATE)
        self._log = make(BLUETOOTH_TX)
        self._sound = make(SOUND)
        self._lcd = make(LCD)

    def tick(self, now_ns: int, outputs: DeviceOutputs, program: Program) -> None:
        """Send the results of a tick at `now_ns` [ns]."""
        # Messages without a stamp go first, so that no reader sees them after the next tick.
        if program.operating_state != self.operating_state:
            self.operating_state = program.operating_state.value
            self._operating_state.message.data = program.operating_state.value
            self._operating_state.send(now_ns)
        for packet in outputs.log:
            fill_log(self._log.message, packet)
            self._log.send(now_ns)
        for tone in outputs.tones:
            fill_tone(self._sound.message, now_ns, tone)
            self._sound.send(now_ns)
        for page in outputs.pages:
            self._lcd.message.data = page
            self._lcd.send(now_ns)
        fill_duty(self._duty.message, now_ns, outputs.duty)
        self._duty.send(now_ns)
        fill_controller_state(self._state.message, now_ns, program.x, program.y)
        self._state.send(now_ns)

    def begin(self) -> None:
        """Begin a run: its first operating state counts as a change."""
        self.operating_state = ''

    def resend(self, stamp_ns: int) -> None:
        """Send the periodic messages of the previous tick again, with `stamp_ns`."""
        self._duty.send(stamp_ns)
        self._state.send(stamp_ns)

    def stop_motors(self, last_ns: int) -> None:
        """Publish that the motors are off from the tick after the last one."""
        send_stop(self._duty, last_ns)
