"""The live inputs of the gamepad node (topics and a gamepad), passed to the arbiter."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.subscription import Subscription

from ballbot_ros.errors import one_line
from ballbot_ros.messages.conversions import planar_velocity
from ballbot_ros.messages.raw import decoder
from ballbot_ros.messages.topics import CMD_VEL, CMD_VEL_STAMPED, JOY, VIEWER_JOY, Topic
from ballbot_ros.nodes.base import BallbotNode
from ballbot_ros.parameters import GamepadParameters
from ballbot_ros.teleop import arbiter
from ballbot_ros.teleop.arbiter import Arbiter
from ballbot_ros.teleop.errors import TeleopError
from ballbot_ros.teleop.gamepad import ANY, Gamepad, GamepadState
from ballbot_ros.teleop.input_errors import InputErrors
from ballbot_ros.teleop.joy_mapping import JoyMapping
from ballbot_ros.teleop.sdl import SdlBackend
from ballbot_ros.teleop.sticks import Sticks
from ballbot_ros.teleop.velocity import VelocityMapping

TYPE_POLL_S = 0.2
"""Interval for looking up the type of ``cmd_vel``."""

NEWEST = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
"""Matches every publisher; of several waiting samples only the newest matters."""


class TeleopInputs:
    """Subscribes to ``joy``, ``viewer/joy`` and ``cmd_vel``, and reads a gamepad.

    The errors of each input are reported by the name of its topic, those of the gamepad as
    ``device``.
    """

    def __init__(
        self, node: BallbotNode[GamepadParameters], sources: Arbiter, input_errors: InputErrors
    ) -> None:
        self._node, self._sources, self._input_errors = node, sources, input_errors
        self._set_mappings()
        self._listen_to_joy(JOY, arbiter.JOY, lambda: self._mapping)
        self._listen_to_joy(VIEWER_JOY, arbiter.VIEWER, lambda: self._screen_mapping)
        self._cmd_vel: Topic | None = None
        self._cmd_vel_subscription: Subscription | None = None
        self._look_for_cmd_vel()
        node.create_wall_timer(TYPE_POLL_S, self._look_for_cmd_vel)
        self._device: str = node.parameters.device
        self._gamepad = self._open_gamepad()

    @property
    def gamepad(self) -> str:
        """Name of the gamepad that is read directly; '' for none."""
        return self._gamepad.name if self._gamepad else ''

    def apply_parameters(self) -> None:
        """Apply the parameters of a run that begins."""
        self._set_mappings()
        if self._node.parameters.device != self._device:
            self.close()
            self._input_errors.clear(arbiter.DEVICE)
            self._device = self._node.parameters.device
            self._gamepad = self._open_gamepad()

    def _set_mappings(self) -> None:
        parameters = self._node.parameters
        self._mapping = JoyMapping.from_parameters(parameters)
        self._screen_mapping = JoyMapping(parameters.gp_max)

    def close(self) -> None:
        """Close the gamepad."""
        if self._gamepad:
            self._gamepad.close()

    def _take(self, source: str, name: str, sticks: Callable[[], Sticks | None]) -> None:
        """Pass the sticks of an input to the arbiter, or release the input if they are unusable."""
        try:
            values = sticks()
        except TeleopError as error:
            self._sources.release(source)
            self.report_input_error(name, str(error))
            return
        self._input_errors.clear(name)
        if values is None:
            self._sources.release(source)
        else:
            self._sources.report(source, values, time.monotonic())

    def report_input_error(self, name: str, text: str) -> None:
        """Log an error of an input, and show it in the diagnostics."""
        if self._input_errors.add(name, text):
            self._node.warn(str(self._input_errors))

    def _subscribe(
        self, topic: Topic, source: str, read: Callable[[Any], Sticks | None]
    ) -> Subscription:
        decode = decoder(topic.type_name)

        def sticks(data: bytes) -> Sticks | None:
            try:
                message = decode(data)
            except ValueError as error:
                raise TeleopError(f'not a valid {topic.type_name}: {one_line(error)}') from None
            return read(message)

        def take(data: bytes) -> None:
            self._take(source, topic.name, lambda: sticks(data))

        return self._node.create_subscription(
            topic.message_class, topic.name, take, NEWEST, raw=True
        )

    def _listen_to_joy(self, topic: Topic, source: str, mapping: Callable[[], JoyMapping]) -> None:
        self._subscribe(
            topic, source, lambda message: mapping().sticks(message.axes, message.buttons)
        )

    def _look_for_cmd_vel(self) -> None:
        """Subscribe to ``cmd_vel`` with its published type: the middleware allows one type only.

        Without a publisher, tools find the topic by this subscription.
        """
        offers = self._node.get_publishers_info_by_topic(CMD_VEL.name)
        types = {offer.topic_type for offer in offers} or {(self._cmd_vel or CMD_VEL).type_name}
        if self._cmd_vel and types == {self._cmd_vel.type_name}:
            self._input_errors.clear(f'{CMD_VEL.name} type')
            return
        # Keep the type that is read already for as long as it is published.
        candidates = (self._cmd_vel, CMD_VEL, CMD_VEL_STAMPED)
        read = next((topic for topic in candidates if topic and topic.type_name in types), None)
        if len(types) > 1 or read is None:
            supported = CMD_VEL.type_name, CMD_VEL_STAMPED.type_name
            advice = (
                f'only {read.type_name} is read: publish a single type'
                if read
                else f'not supported: publish {" or ".join(supported)}'
            )
            self.report_input_error(
                f'{CMD_VEL.name} type', f'published as {", ".join(sorted(types))}; {advice}'
            )
        if read in (None, self._cmd_vel):
            return
        if self._cmd_vel_subscription is not None:
            # Subscribe at the next call: by then the middleware has released the old type.
            self._node.destroy_subscription(self._cmd_vel_subscription)
            self._cmd_vel = self._cmd_vel_subscription = None
            self._sources.release(arbiter.CMD_VEL)
            return
        self._listen_to_cmd_vel(read)

    def _listen_to_cmd_vel(self, topic: Topic) -> None:
        def read(message: Any) -> Sticks | None:
            twist = message.twist if topic is CMD_VEL_STAMPED else message
            velocity = VelocityMapping.from_parameters(self._node.parameters)
            return velocity.sticks(*planar_velocity(twist))

        try:
            self._cmd_vel_subscription = self._subscribe(topic, arbiter.CMD_VEL, read)
            self._cmd_vel = topic
        except RuntimeError as error:
            # Another node of this process reads ``cmd_vel`` with another type.
            self.report_input_error(f'{CMD_VEL.name} type', one_line(error))

    def _open_gamepad(self) -> Gamepad | None:
        wanted = self._device
        if not wanted:
            return None
        try:
            backend = SdlBackend()
        except TeleopError as error:
            if wanted != ANY:
                raise
            self._node.get_logger().info(f'no gamepad: {error}')
            return None

        def take(state: GamepadState) -> None:
            self._take(arbiter.DEVICE, arbiter.DEVICE, lambda: self._mapping.sticks(*state))

        return Gamepad(
            wanted,
            backend,
            on_state=take,
            on_disconnected=lambda: self._sources.release(arbiter.DEVICE),
            on_problem=lambda text: self.report_input_error(arbiter.DEVICE, text),
        )
