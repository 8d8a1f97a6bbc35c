"""The keyboard of the gamepad node: terminal, status display and reset key."""

from __future__ import annotations

import signal
import time
from collections.abc import Callable, Mapping

from std_srvs.srv import Trigger

from ballbot_ros.controllers.interface import OperatingState
from ballbot_ros.messages.message_types import Text
from ballbot_ros.messages.topics import OPERATING_STATE
from ballbot_ros.nodes.base import BallbotNode
from ballbot_ros.parameters import PLANT, GamepadParameters
from ballbot_ros.teleop.arbiter import KEYBOARD, Arbiter, Command
from ballbot_ros.teleop.keyboard import KeyboardSticks
from ballbot_ros.teleop.terminal import Terminal


class TeleopTerminal:
    """Drives from the keyboard, until the terminal disappears (`is_closed`).

    Attributes
    ----------
    on_key : callable
        Called for every key, on the keyboard's thread.
    """

    def __init__(
        self, node: BallbotNode[GamepadParameters], sources: Arbiter, command: Callable[[], Command]
    ) -> None:
        self._node, self._sources, self._command = node, sources, command
        self._state = ''
        self.is_closed = False
        self.on_key: Callable[[], None] = lambda: None
        self._subscription = node.subscribe(OPERATING_STATE, self._on_state)
        self._reset = node.create_client(Trigger, f'{PLANT}/reset')
        # Ignore SIGHUP: a node that loses its terminal loses an input, but must not end.
        signal.signal(signal.SIGHUP, signal.SIG_IGN)
        self._keys = KeyboardSticks(node.parameters.gp_max)
        self._terminal = Terminal(
            self._keys,
            self._status,
            on_sticks=lambda sticks: sources.report(KEYBOARD, sticks, time.monotonic()),
            on_reset=lambda: self._reset.call_async(Trigger.Request()),
            on_quit=node.finish,
            on_key=self._on_key,
            on_closed=self._on_closed,
        )

    def apply_parameters(self) -> None:
        """Apply the parameters of a run that begins."""
        self._keys.full = self._node.parameters.gp_max

    def close(self) -> None:
        """Restore the terminal."""
        self._terminal.close()
        self._node.destroy_subscription(self._subscription)
        self._node.destroy_client(self._reset)

    def _on_key(self) -> None:
        self.on_key()

    def _on_state(self, message: Text) -> None:
        self._state = message.data

    def _on_closed(self) -> None:
        self._sources.release(KEYBOARD)
        self.is_closed = True

    def _status(self) -> Mapping[str, str]:
        command = self._command()
        vertical, horizontal = command.sticks
        fallen = '   press r to restart' if self._state == OperatingState.OUT_OF_CONTROL else ''
        return {
            'sim time': f'{self._node.now_ns * 1e-9:.1f} s',
            'state': self._state + fallen,
            'in command': command.source_name(self._node.parameters.scenario),
            'sticks': f'vertical {vertical:+d}   horizontal {horizontal:+d}',
        }
