"""The gamepad node: publishes the sticks of the input in command; live inputs have priority."""

from __future__ import annotations

import sys
import time
from collections.abc import Mapping
from pathlib import Path

from rclpy.subscription import Subscription

from ballbot_ros.brick.bluetooth import PacketError
from ballbot_ros.errors import BallbotError
from ballbot_ros.messages.conversions import encode_sticks, log_packet
from ballbot_ros.messages.message_types import Bytes
from ballbot_ros.messages.raw import stamp_of
from ballbot_ros.messages.topics import BLUETOOTH_TX, GAMEPAD_JOY, HISTORY, PLANT_SLOW_ODOM
from ballbot_ros.nodes.base import BallbotNode, run_node
from ballbot_ros.nodes.participation import Participation
from ballbot_ros.nodes.teleop_inputs import TeleopInputs
from ballbot_ros.nodes.teleop_terminal import TeleopTerminal
from ballbot_ros.parameters import GamepadParameters
from ballbot_ros.scenario.library import scenario_of
from ballbot_ros.simulation.lockstep import Run
from ballbot_ros.teleop.arbiter import SCENARIO, Arbiter, Command, GivenAnswers
from ballbot_ros.teleop.csv_log import CsvLog
from ballbot_ros.teleop.device_list import list_devices
from ballbot_ros.teleop.errors import TeleopError
from ballbot_ros.teleop.gamepad import ANY
from ballbot_ros.teleop.input_errors import InputErrors
from ballbot_ros.teleop.sdl import SdlBackend
from ballbot_ros.teleop.sticks import NEUTRAL
from ballbot_ros.teleop.terminal import keyboard_unavailable_reason
from ballbot_ros.timing import MILLISECOND_NS, SLOW_PERIOD_NS

LIST_DEVICES = '--list-devices'
FLUSH_PERIOD_S = 0.5


class GamepadTeleop(BallbotNode[GamepadParameters]):
    """Answers each ``plant/odom/_slow``, every 20 ms, with a ``gamepad`` of that stamp."""

    def __init__(self, parameters: GamepadParameters | None = None) -> None:
        super().__init__(GamepadParameters, parameters)
        self._scenario = scenario_of(self.parameters.scenario)
        self._start_ns = 0
        self._answers = GivenAnswers()
        self._command = Command(SCENARIO, NEUTRAL)
        self._output = self.output(GAMEPAD_JOY)
        self._sources = Arbiter()
        self._input_errors = InputErrors()
        self._log: CsvLog | None = None
        self._log_subscription: Subscription | None = None
        self._set_log()  # may fail; so before a thread reads the gamepad
        self._inputs = TeleopInputs(self, self._sources, self._input_errors)
        self.terminal: TeleopTerminal | None = None
        self._set_terminal()
        self.create_wall_timer(FLUSH_PERIOD_S, self._flush_log)
        self._participation = Participation(self, self._on_run)
        # A controller that does not wait for the sticks lets the plant run ahead.
        self.subscribe(PLANT_SLOW_ODOM, self._on_truth, depth=HISTORY, raw=True)

    def check(self, parameters: GamepadParameters) -> None:
        """Check that scenario, terminal and gamepad are available, and that the log file is new."""
        scenario_of(parameters.scenario)
        path = parameters.log_csv
        if path and path != self.parameters.log_csv and Path(path).exists():
            raise TeleopError(f'{path}: already exists; choose another file')
        is_new = parameters.keyboard and not self.parameters.keyboard
        if is_new and (obstacle := keyboard_unavailable_reason()):
            raise TeleopError(f'keyboard: {obstacle}')
        if parameters.device not in ('', ANY):
            SdlBackend()

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
            self.terminal.apply_parameters()
        if self.parameters.log_csv != before.log_csv:
            self._close_log()
            try:
                self._set_log()
            except TeleopError as error:
                self._give_up_log(error)

    def _set_terminal(self) -> None:
        if self.terminal:
            self.terminal.close()
            self.terminal = None
        if self.parameters.keyboard:
            # Imported only here: it takes a while, and only a terminal needs it.
            from ballbot_ros.nodes.robot_status import RobotStatus

            self.terminal = TeleopTerminal(
                self, self._sources, lambda: self._command, RobotStatus(self)
            )

    def _set_log(self) -> None:
        if self.parameters.log_csv:
            self._log = CsvLog(Path(self.parameters.log_csv))
            if self._log_subscription is None:
                self._log_subscription = self.subscribe(BLUETOOTH_TX, self._on_log, depth=HISTORY)

    def _on_run(self, run: Run) -> None:
        self._start_ns = run.start_ns
        self._answers = GivenAnswers()
        if self._log:
            self._log.begin_run(run.start_ns // MILLISECOND_NS)

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
        answer = self._answers.at(now_ns, lambda: self._select(elapsed_s))
        self._output.publish(encode_sticks(now_ns, answer.sticks, answer.source))
        self.count_answer(now_ns)

    def _select(self, elapsed_s: float) -> Command:
        before = self._source_name()
        scenario = self._scenario.sticks_at(elapsed_s)
        self._command = self._sources.select(time.monotonic(), scenario)
        if self._source_name() != before:
            self.get_logger().info(f'in command: {self._source_name()} (was {before})')
        return self._command

    def _source_name(self) -> str:
        return self._command.source_name(self.parameters.scenario)

    def _on_log(self, message: Bytes) -> None:
        if self._log is None:
            return
        try:
            self._log.write(log_packet(message))
            self._input_errors.clear(BLUETOOTH_TX.name)
        except PacketError as error:
            self._inputs.report_input_error(BLUETOOTH_TX.name, f'{error}; packet skipped')
        except TeleopError as error:
            self._give_up_log(error)

    def _flush_log(self) -> None:
        if self._log:
            try:
                self._log.flush()
            except TeleopError as error:
                self._give_up_log(error)

    def _give_up_log(self, error: BallbotError) -> None:
        self._log = None
        self.fail(f'log_csv: {error}')

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
        """Restore the terminal, close the gamepad, and finish the log."""
        if self.terminal:
            self.terminal.close()
        self._inputs.close()
        self._close_log()

    def _close_log(self) -> None:
        if self._log:
            try:
                self._log.close()
                self._log = None
            except TeleopError as error:
                self._give_up_log(error)


def main() -> None:
    """Run the node, or list the gamepads."""
    if LIST_DEVICES in sys.argv[1:]:
        try:
            list_devices()
        except BallbotError as error:
            print(f'error: {error}', file=sys.stderr)
            sys.exit(2)
        return
    sys.exit(run_node(GamepadTeleop))
