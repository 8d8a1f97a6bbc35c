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
        self._sink = sink
        self._ball_radius = ball_radius
        self._drive_state = ''
        self._outputs: dict[Topic, tuple[Any, Callable[[Any], bytes]]] = {}

    def _message(self, topic: Topic) -> Any:
        """Return the message of a topic, which is filled again and again."""
        output = self._outputs.get(topic)
        if output is None:
            output = new_message(topic.type_name), encoder(topic.type_name)
            self._outputs[topic] = output
        return output[0]

    def _send(self, topic: Topic, stamp_ns: int) -> None:
        message, encode = self._outputs[topic]
        self._sink(topic, stamp_ns, encode(message))

    def begin(self, start_ns: int, world: World | None) -> None:
        """Make what a run begins with."""
        fill_header(self._message(RUN), start_ns, '1')
        self._send(RUN, start_ns)
        if world:
            fill_map(self._message(MAP), start_ns, occupancy_grid(world.map))
            self._send(MAP, start_ns)
        self._message(WALL_HIT).data = False
        self._send(WALL_HIT, start_ns)

    def push(self, push: Push, number: int) -> None:
        """Make what tells of a push that the plant has accepted."""
        for stamp, acts in ((push.start_ns, True), (push.end_ns, False)):
            fill_accepted_push(self._message(ACCEPTED_PUSH), stamp, push, number, acts=acts)
            self._send(ACCEPTED_PUSH, stamp)

    def truth(self, truth: Truth, *, wall_hit: bool) -> None:
        """Make what the plant publishes at a tick."""
        now = truth.stamp_ns
        fill_clock(self._message(CLOCK), now)
        self._send(CLOCK, now)
        fill_body(self._message(PLANT_IMU), truth)
        self._send(PLANT_IMU, now)
        fill_motors(self._message(PLANT_JOINT_STATES), truth)
        self._send(PLANT_JOINT_STATES, now)
        if now % BATTERY_NS == 0:
            fill_battery(self._message(BATTERY_STATE), truth)
            self._send(BATTERY_STATE, now)
        fill_odometry(self._message(PLANT_ODOM), truth, self._ball_radius)
        self._send(PLANT_ODOM, now)
        hit = self._message(WALL_HIT)
        if wall_hit != hit.data:
            hit.data = wall_hit
            self._send(WALL_HIT, now)

    def devices(self, now: int, inputs: DeviceInputs, source: str = SCENARIO) -> None:
        """Make what the drivers publish at a tick; `source` has the gamepad's command."""
        fill_gyro(self._message(GYRO_IMU), now, inputs.gyro)
        self._send(GYRO_IMU, now)
        fill_encoders(self._message(JOINT_STATES), now, inputs.revolutions)
        self._send(JOINT_STATES, now)
        if inputs.sonar_cm is not None:
            fill_sonar(self._message(SONAR_RANGE), now, inputs.sonar_cm)
            self._send(SONAR_RANGE, now)
        if inputs.sticks is not None:
            fill_sticks(self._message(GAMEPAD_JOY), now, inputs.sticks, source)
            self._send(GAMEPAD_JOY, now)

    def controller(self, now: int, outputs: DeviceOutputs, program: Program) -> None:
        """Make what the controller publishes at a tick."""
        fill_duty(self._message(MOTOR_DUTY), now, outputs.duty)
        self._send(MOTOR_DUTY, now)
        fill_controller_state(self._message(CONTROLLER_STATE), now, program.x, program.y)
        self._send(CONTROLLER_STATE, now)
        if program.drive_state != self._drive_state:
            self._drive_state = program.drive_state
            self._message(OPERATING_STATE).data = self._drive_state
            self._send(OPERATING_STATE, now)
        for packet in outputs.log:
            fill_log(self._message(BLUETOOTH_TX), packet)
            self._send(BLUETOOTH_TX, now)
        for tone in outputs.tones:
            fill_tone(self._message(SOUND), now, tone)
            self._send(SOUND, now)
        for page in outputs.pages:
            self._message(LCD).data = page
            self._send(LCD, now)
