"""The messages of a real robot: what its data log tells, under the simulation's names and units."""

from __future__ import annotations

from ballbot_ros.controllers.interface import Estimates
from ballbot_ros.parameters import LogFormat
from ballbot_ros.recording.messages import topics
from ballbot_ros.recording.messages.conversions import (
    encode_battery,
    encode_controller_state,
    encode_duty,
    encode_header,
    encode_log,
    encode_sticks,
)
from ballbot_ros.recording.messages.devices import encode_encoders, encode_gyro, encode_sonar
from ballbot_ros.recording.messages.run_messages import MakeSend
from ballbot_ros.robot.brick.bluetooth import LogPacket, Sticks
from ballbot_ros.robot.brick.sensors import NO_DATA_CM


class BrickMessages:
    """Encodes and sends the messages that stand for log packets, and for sticks sent to the brick.

    The log has no true state, no rates and no references, so no message has them.
    """

    def __init__(self, make: MakeSend, log_format: LogFormat) -> None:
        self._format = log_format
        self._send_run = make(topics.RUN)
        self._send_log = make(topics.BLUETOOTH_TX)
        self._send_battery = make(topics.BATTERY_STATE)
        self._send_encoders = make(topics.JOINT_STATES)
        self._send_sonar = make(topics.SONAR_RANGE)
        self._send_state = make(topics.CONTROLLER_STATE)
        self._send_duty = make(topics.MOTOR_DUTY)
        self._send_gyro = make(topics.GYRO_IMU)
        self._send_sticks = make(topics.GAMEPAD_JOY)

    def begin(self, start_ns: int, name: str) -> None:
        """Announce a run of the brick's program."""
        self._send_run(start_ns, encode_header(start_ns, name))

    def packet(self, stamp_ns: int, packet: LogPacket) -> None:
        """Send what a packet tells of its time [ns]."""
        self._send_log(stamp_ns, encode_log(packet))
        self._send_battery(stamp_ns, encode_battery(stamp_ns, packet.battery_mv / 1000.0))
        self._send_encoders(stamp_ns, encode_encoders(stamp_ns, (packet.rev_b, packet.rev_c)))
        if packet.sonar_cm != NO_DATA_CM:  # before the program's first request
            self._send_sonar(stamp_ns, encode_sonar(stamp_ns, packet.sonar_cm))
        x = self._estimates(packet.rev_b, packet.adc1)
        y = self._estimates(packet.rev_c, packet.adc2)
        self._send_state(stamp_ns, encode_controller_state(stamp_ns, x, y))
        content = self._format.log_content
        if content != 'pitch':
            self._send_duty(stamp_ns, encode_duty(stamp_ns, (packet.data1, packet.data2)))
        if content == 'duties_and_gyros':
            self._send_gyro(stamp_ns, encode_gyro(stamp_ns, (packet.adc3, packet.adc4)))

    def _estimates(self, revolution: int, pitch: int) -> Estimates:
        """Return the program's estimates of ball angle and pitch in a plane (section 7.4)."""
        psi = self._format.lsb * pitch
        theta = self._format.wheel_radius / self._format.ball_radius * revolution + psi
        return Estimates(theta=theta, psi=psi)

    def sticks(self, stamp_ns: int, sticks: Sticks, source: str) -> None:
        """Send the sticks that went to the brick, and which input they came from."""
        self._send_sticks(stamp_ns, encode_sticks(stamp_ns, sticks, source))
