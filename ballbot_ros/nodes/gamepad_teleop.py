"""The gamepad node: publishes the sticks of the input in command; live inputs have priority."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.subscription import Subscription

from ballbot_ros.engine.scenario.reader import scenario_of
from ballbot_ros.errors import TeleopError, one_line
from ballbot_ros.lockstep.lockstep import GivenAnswers, RunIdentity
from ballbot_ros.nodes.base import BallbotNode
from ballbot_ros.nodes.participation import Participation
from ballbot_ros.nodes.teleop import sticks as arbiter
from ballbot_ros.nodes.teleop.gamepad import ANY, Gamepad, GamepadState, InputErrors, SdlBackend
from ballbot_ros.nodes.teleop.sticks import Arbiter, Command, JoyMapping, VelocityMapping
from ballbot_ros.parameters import GamepadParameters
from ballbot_ros.parameters.timing import SLOW_PERIOD_NS
from ballbot_ros.recording.messages.conversions import encode_sticks, planar_velocity
from ballbot_ros.recording.messages.raw import decoder, stamp_of
from ballbot_ros.recording.messages.topics import (
    CMD_VEL,
    CMD_VEL_STAMPED,
    GAMEPAD_JOY,
    HISTORY,
    JOY,
    PLANT_SLOW_ODOM,
    SCENARIO,
    VIEWER_JOY,
    Topic,
)
from ballbot_ros.robot.brick.bluetooth import NEUTRAL, Sticks
from ballbot_ros.robot.brick.fault_effects import fault_row, packet_time
from ballbot_ros.robot.brick.faults import faults_of
from ballbot_ros.robot.random_numbers import noise_key

if TYPE_CHECKING:
    from ballbot_ros.nodes.teleop.terminal import Terminal

TYPE_POLL_S = 0.2
"""Interval for looking up the type of ``cmd_vel``."""

NEWEST = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
"""Matches every publisher; of several waiting samples only the newest matters."""


class TeleopInputs:
    """Subscribes to ``joy``, ``viewer/joy`` and ``cmd_vel``, and reads a gamepad.

    The errors of each input are reported by the name of its topic, those of the gamepad as
    ``device``.
    """

    def __init__(self, node: BallbotNode[Any], sources: Arbiter, input_errors: InputErrors) -> None:
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


class GamepadTeleop(BallbotNode[GamepadParameters]):
    """Answers each ``plant/odom/_slow``, every 20 ms, with a ``gamepad`` of that stamp."""

    def __init__(self, parameters: GamepadParameters | None = None) -> None:
        super().__init__(GamepadParameters, parameters)
        self._scenario = scenario_of(self.parameters.scenario)
        self._start_ns = 0
        self._answers = GivenAnswers[Command]()
        self._sent: dict[int, Command] = {}
        self._faults = fault_row(faults_of(self.parameters), 0)
        self._command = Command(SCENARIO, NEUTRAL)
        self._output = self.output(GAMEPAD_JOY)
        self._sources = Arbiter()
        self._input_errors = InputErrors()
        self._inputs = TeleopInputs(self, self._sources, self._input_errors)
        self.terminal: Terminal | None = None
        self._set_terminal()
        self._participation = Participation(self, self._on_run)
        # A controller that does not wait for the sticks lets the plant run ahead.
        self.subscribe(PLANT_SLOW_ODOM, self._on_truth, depth=HISTORY, raw=True)

    def check(self, parameters: GamepadParameters) -> None:
        """Check that scenario, terminal and gamepad are available."""
        scenario_of(parameters.scenario)
        faults_of(parameters)
        if parameters.keyboard and not self.parameters.keyboard:
            from ballbot_ros.nodes.teleop.terminal import keyboard_unavailable_reason

            if obstacle := keyboard_unavailable_reason():
                raise TeleopError(f'keyboard: {obstacle}')
        if parameters.device not in ('', ANY):
            SdlBackend()

    def on_parameters_changed(self) -> None:
        """Let other faults act."""
        self._participation.change_faults(self._faults)

    def apply_parameters(self) -> None:
        """Apply the new parameter values at the start of a run."""
        before = self.parameters
        super().apply_parameters()
        if self.parameters == before:
            return
        self._scenario = scenario_of(self.parameters.scenario)
        self._inputs.apply_parameters()
        if self.parameters.keyboard != before.keyboard:
            self._set_terminal()
        elif self.terminal:
            self.terminal.keys.full = self.parameters.gp_max

    def _set_terminal(self) -> None:
        self._close_terminal()
        if self.parameters.keyboard:
            # Imported only here: it takes a while, and most runs have no keyboard.
            from ballbot_ros.nodes.plant_display import PlantDisplay
            from ballbot_ros.nodes.teleop.terminal import KeyboardSticks, Terminal

            display = self._display = PlantDisplay(self)
            self.terminal = Terminal(
                KeyboardSticks(self.parameters.gp_max),
                self._sources,
                lambda: (self._source_name(), self._command.sticks),
                display.lines,
                on_quit=self.finish,
                on_reset=display.restart,
            )

    def _close_terminal(self) -> None:
        if self.terminal:
            self.terminal.close()
            self._display.close()
            self.terminal = None

    def _on_run(self, run: RunIdentity) -> None:
        self._start_ns = run.start_ns
        self._answers = GivenAnswers[Command]()
        self._sent = {}
        self._faults = fault_row(faults_of(self.parameters), run.start_ns)

    def _on_truth(self, truth: bytes) -> None:
        try:
            now_ns = stamp_of(truth)
        except ValueError as error:
            self.warn_malformed(PLANT_SLOW_ODOM, error)
            return
        if now_ns % SLOW_PERIOD_NS == 0 and self._participation.includes(now_ns):
            self._answer(now_ns)

    def _answer(self, now_ns: int) -> None:
        elapsed_s = (now_ns - self._start_ns) * 1e-9
        answer = self._answers.at(now_ns, lambda: self._arrived(now_ns, self._select(elapsed_s)))
        self._output.publish(encode_sticks(now_ns, answer.sticks, answer.source))
        self.count_answer(now_ns)

    def _arrived(self, now_ns: int, command: Command) -> Command:
        """Return what has reached the brick, which faults of the link make older."""
        self._sent[now_ns] = command
        newest_ns = packet_time(self._faults, now_ns, noise_key(self.parameters.seed))
        known = [stamp for stamp in self._sent if stamp <= newest_ns]
        for stamp in known[:-1]:
            del self._sent[stamp]  # never needed again
        return self._sent[known[-1]] if known else Command(SCENARIO, NEUTRAL)

    def _select(self, elapsed_s: float) -> Command:
        before = self._source_name()
        scenario = self._scenario.sticks_at(elapsed_s)
        if elapsed_s < self.parameters.live_from:
            return Command(SCENARIO, scenario)
        self._command = self._sources.select(time.monotonic(), scenario)
        if self._source_name() != before:
            self.get_logger().info(f'in command: {self._source_name()} (was {before})')
        return self._command

    def _source_name(self) -> str:
        return self._command.source_name(self.parameters.scenario)

    def report(self) -> None:
        """Publish the diagnostics, then drop the input errors that were cleared."""
        super().report()
        self._input_errors.remove_cleared()
        if str(self._input_errors):
            self.warn(str(self._input_errors))
        else:
            self.clear_warning()

    def diagnose(self) -> Mapping[str, object]:
        """Return the input in command."""
        vertical, horizontal = self._command.sticks
        return {
            'in command': self._source_name(),
            'sticks': f'{vertical} {horizontal}',
            'gamepad': self._inputs.gamepad or 'none',
        }

    def close(self) -> None:
        """Restore the terminal, close the gamepad, and let the last sample arrive."""
        self._close_terminal()
        self.flush(GAMEPAD_JOY)
        self._inputs.close()
