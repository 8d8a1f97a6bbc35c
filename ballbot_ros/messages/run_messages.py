"""The messages of a run without a graph: the same topics with the same content."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from ballbot_ros.brick.brick import DeviceInputs, DeviceOutputs
from ballbot_ros.controller.interface import Program
from ballbot_ros.messages.conversions import (
    fill_accepted_push,
    fill_battery,
    fill_body,
    fill_clock,
    fill_controller_state,
    fill_duty,
    fill_encoders,
    fill_gyro,
    fill_header,
    fill_log,
    fill_map,
    fill_motors,
    fill_odometry,
    fill_sonar,
    fill_sticks,
    fill_tone,
)
from ballbot_ros.messages.topics import (
    ACCEPTED_PUSH,
    BATTERY_STATE,
    BLUETOOTH_TX,
    CLOCK,
    CONTROLLER_STATE,
    GAMEPAD_JOY,
    GYRO_IMU,
    JOINT_STATES,
    LCD,
    MAP,
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
from ballbot_ros.plant.truth import Push, Truth
from ballbot_ros.recording.encoding import encoder, new_message
from ballbot_ros.simulation.timing import BATTERY_NS
from ballbot_ros.teleop.arbiter import SCENARIO
from ballbot_ros.world.exports import occupancy_grid
from ballbot_ros.world.world import World

Sink = Callable[[Topic, int, bytes], None]
"""Takes a message: its topic, its stamp [ns], and itself as CDR."""


class RunMessages:
    """Makes the messages that the nodes would publish, in the order of cause.

    Parameters
    ----------
    sink : callable
        What takes them.
    ball_radius : float
        Height of the ball's centre [m].
    """

    def __init__(self, sink: Sink, ball_radius: float) -> None:
        self._ball_radius = ball_radius
        self._drive_state = ''
        self._run = _Output(RUN, sink)
        self._map = _Output(MAP, sink)
        self._wall_hit = _Output(WALL_HIT, sink)
        self._accepted_push = _Output(ACCEPTED_PUSH, sink)
        self._clock = _Output(CLOCK, sink)
        self._body = _Output(PLANT_IMU, sink)
        self._motors = _Output(PLANT_JOINT_STATES, sink)
        self._battery = _Output(BATTERY_STATE, sink)
        self._odometry = _Output(PLANT_ODOM, sink)
        self._gyro = _Output(GYRO_IMU, sink)
        self._encoders = _Output(JOINT_STATES, sink)
        self._sonar = _Output(SONAR_RANGE, sink)
        self._gamepad = _Output(GAMEPAD_JOY, sink)
        self._duty = _Output(MOTOR_DUTY, sink)
        self._state = _Output(CONTROLLER_STATE, sink)
        self._operating_state = _Output(OPERATING_STATE, sink)
        self._log = _Output(BLUETOOTH_TX, sink)
        self._sound = _Output(SOUND, sink)
        self._lcd = _Output(LCD, sink)

    def begin(self, start_ns: int, world: World | None) -> None:
        """Make what a run begins with."""
        fill_header(self._run.message, start_ns, '1')
        self._run.send(start_ns)
        if world:
            fill_map(self._map.message, start_ns, occupancy_grid(world.map))
            self._map.send(start_ns)
        self._wall_hit.message.data = False
        self._wall_hit.send(start_ns)

    def push(self, push: Push, number: int) -> None:
        """Make what tells of a push that the plant has accepted."""
        for stamp, acts in ((push.start_ns, True), (push.end_ns, False)):
            fill_accepted_push(self._accepted_push.message, stamp, push, number, acts=acts)
            self._accepted_push.send(stamp)

    def truth(self, truth: Truth, *, wall_hit: bool) -> None:
        """Make what the plant publishes at a tick."""
        now = truth.stamp_ns
        fill_clock(self._clock.message, now)
        self._clock.send(now)
        fill_body(self._body.message, truth)
        self._body.send(now)
        fill_motors(self._motors.message, truth)
        self._motors.send(now)
        if now % BATTERY_NS == 0:
            fill_battery(self._battery.message, truth)
            self._battery.send(now)
        fill_odometry(self._odometry.message, truth, self._ball_radius)
        self._odometry.send(now)
        hit = self._wall_hit.message
        if wall_hit != hit.data:
            hit.data = wall_hit
            self._wall_hit.send(now)

    def devices(self, now: int, inputs: DeviceInputs, source: str = SCENARIO) -> None:
        """Make what the drivers publish at a tick; `source` has the gamepad's command."""
        fill_gyro(self._gyro.message, now, inputs.gyro)
        self._gyro.send(now)
        fill_encoders(self._encoders.message, now, inputs.revolutions)
        self._encoders.send(now)
        if inputs.sonar_cm is not None:
            fill_sonar(self._sonar.message, now, inputs.sonar_cm)
            self._sonar.send(now)
        if inputs.sticks is not None:
            fill_sticks(self._gamepad.message, now, inputs.sticks, source)
            self._gamepad.send(now)

    def controller(self, now: int, outputs: DeviceOutputs, program: Program) -> None:
        """Make what the controller publishes at a tick."""
        fill_duty(self._duty.message, now, outputs.duty)
        self._duty.send(now)
        fill_controller_state(self._state.message, now, program.x, program.y)
        self._state.send(now)
        if program.drive_state != self._drive_state:
            self._drive_state = program.drive_state
            self._operating_state.message.data = self._drive_state
            self._operating_state.send(now)
        for packet in outputs.log:
            fill_log(self._log.message, packet)
            self._log.send(now)
        for tone in outputs.tones:
            fill_tone(self._sound.message, now, tone)
            self._sound.send(now)
        for page in outputs.pages:
            self._lcd.message.data = page
            self._lcd.send(now)


class _Output:
    """A topic's message, which is filled again and again."""

    def __init__(self, topic: Topic, sink: Sink) -> None:
        self.message: Any = new_message(topic.type_name)
        self._encode = encoder(topic.type_name)
        self._topic = topic
        self._sink = sink

    def send(self, stamp_ns: int) -> None:
        self._sink(self._topic, stamp_ns, self._encode(self.message))
