"""The recording of a run without a graph: the same topics with the same content."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ballbot_ros.controller.program import ControlProgram
from ballbot_ros.nodes.conversions import (
    fill_battery,
    fill_body,
    fill_clock,
    fill_controller_state,
    fill_duty,
    fill_encoders,
    fill_gyro,
    fill_header,
    fill_log,
    fill_motors,
    fill_odometry,
    fill_sonar,
    fill_sticks,
    fill_tone,
)
from ballbot_ros.nodes.topics import (
    BATTERY_STATE,
    BLUETOOTH_TX,
    CLOCK,
    CONTROLLER_STATE,
    GAMEPAD_JOY,
    GYRO_IMU,
    JOINT_STATES,
    LCD,
    MOTOR_DUTY,
    OPERATING_STATE,
    PLANT_IMU,
    PLANT_JOINT_STATES,
    PLANT_ODOM,
    RUN,
    SONAR_RANGE,
    SOUND,
    WALL_HIT,
    Topic,
)
from ballbot_ros.recording.encoding import encoder, new_message
from ballbot_ros.recording.writer import RecordingWriter
from ballbot_ros.simulation.closed_loop import Tick
from ballbot_ros.simulation.timing import SECOND_NS


class SimulatedRecording:
    """Writes the messages that the nodes would have published.

    Parameters
    ----------
    path : Path
        The file to create.
    attachments : mapping of str to bytes
        Files to attach.
    ball_radius : float
        Height of the ball's centre [m].
    """

    def __init__(self, path: Path, attachments: Mapping[str, bytes], ball_radius: float) -> None:
        self._writer = RecordingWriter(path)
        for name, data in attachments.items():
            self._writer.add_attachment(name, 'application/yaml', data)
        self._ball_radius = ball_radius
        self._flushed_ns = 0
        self._drive_state = ''
        self._clock = _Output(self._writer, CLOCK)
        self._run = _Output(self._writer, RUN)
        self._wall_hit = _Output(self._writer, WALL_HIT)
        self._motors = _Output(self._writer, PLANT_JOINT_STATES)
        self._body = _Output(self._writer, PLANT_IMU)
        self._odometry = _Output(self._writer, PLANT_ODOM)
        self._battery = _Output(self._writer, BATTERY_STATE)
        self._gyro = _Output(self._writer, GYRO_IMU)
        self._encoders = _Output(self._writer, JOINT_STATES)
        self._sonar = _Output(self._writer, SONAR_RANGE)
        self._gamepad = _Output(self._writer, GAMEPAD_JOY)
        self._duty = _Output(self._writer, MOTOR_DUTY)
        self._state = _Output(self._writer, CONTROLLER_STATE)
        self._operating_state = _Output(self._writer, OPERATING_STATE)
        self._log = _Output(self._writer, BLUETOOTH_TX)
        self._sound = _Output(self._writer, SOUND)
        self._lcd = _Output(self._writer, LCD)

    def begin(self, start_ns: int) -> None:
        """Write what a run begins with."""
        fill_header(self._run.message, start_ns, '1')
        self._run.write(start_ns)
        self._wall_hit.write(start_ns)
        self._flushed_ns = start_ns

    def add(self, tick: Tick, program: ControlProgram) -> None:
        """Write the messages of a tick."""
        truth, inputs, outputs = tick
        now = truth.stamp_ns
        fill_clock(self._clock.message, now)
        self._clock.write(now)
        fill_body(self._body.message, truth)
        self._body.write(now)
        fill_motors(self._motors.message, truth)
        self._motors.write(now)
        if inputs.battery_mv is not None:
            fill_battery(self._battery.message, truth)
            self._battery.write(now)
        fill_odometry(self._odometry.message, truth, self._ball_radius)
        self._odometry.write(now)
        fill_gyro(self._gyro.message, now, inputs.gyro)
        self._gyro.write(now)
        fill_encoders(self._encoders.message, now, inputs.revolutions)
        self._encoders.write(now)
        if inputs.sonar_cm is not None:
            fill_sonar(self._sonar.message, now, inputs.sonar_cm)
            self._sonar.write(now)
        if inputs.sticks is not None:
            fill_sticks(self._gamepad.message, now, inputs.sticks)
            self._gamepad.write(now)
        fill_duty(self._duty.message, now, outputs.duty)
        self._duty.write(now)
        fill_controller_state(self._state.message, now, program.x, program.y)
        self._state.write(now)
        self._add_events(tick, program)
        if now - self._flushed_ns >= SECOND_NS:
            self._writer.flush()
            self._flushed_ns = now

    def _add_events(self, tick: Tick, program: ControlProgram) -> None:
        now, outputs = tick.truth.stamp_ns, tick.outputs
        if program.drive_state != self._drive_state:
            self._drive_state = self._operating_state.message.data = program.drive_state
            self._operating_state.write(now)
        for packet in outputs.log:
            fill_log(self._log.message, packet)
            self._log.write(now)
        for tone in outputs.tones:
            fill_tone(self._sound.message, now, tone)
            self._sound.write(now)
        for page in outputs.pages:
            self._lcd.message.data = page
            self._lcd.write(now)

    def close(self, outcome: Mapping[str, Any]) -> None:
        """Say how the run ended, and finish the file."""
        self._writer.add_outcome(outcome)
        self._writer.close()


class _Output:
    """A topic of the recording, and the message that is filled again and again."""

    def __init__(self, writer: RecordingWriter, topic: Topic) -> None:
        self.message: Any = new_message(topic.type_name)
        self._encode = encoder(topic.type_name)
        self._writer = writer
        name = topic.name if topic.name.startswith('/') else f'/{topic.name}'
        self._topic = writer.add_topic(name, topic.type_name)
        self._count = 0

    def write(self, stamp_ns: int) -> None:
        self._count += 1
        self._writer.write(self._topic, stamp_ns, self._encode(self.message), self._count)
