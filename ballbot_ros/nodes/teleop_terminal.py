"""The keyboard of the gamepad node: terminal, status display and reset key."""

from __future__ import annotations

import signal
import time
from collections.abc import Callable, Mapping
from typing import Any

from std_srvs.srv import Trigger

from ballbot_ros.nodes.base import BallbotNode
from ballbot_ros.nodes.latest_messages import LatestMessages
from ballbot_ros.nodes.teleop.sticks import KEYBOARD, Arbiter
from ballbot_ros.nodes.teleop.terminal import KeyboardSticks, Terminal
from ballbot_ros.parameters import PLANT, GamepadParameters
from ballbot_ros.recording.messages.topics import (
    OPERATING_STATE,
    PLANT_IMU,
    PLANT_ODOM,
    RUN,
    SONAR_RANGE,
)
from ballbot_ros.robot.brick.bluetooth import Sticks
from ballbot_ros.viewer.run_activity import RealTimeFactor, drive_status

_TOPICS = (PLANT_IMU, PLANT_ODOM, SONAR_RANGE, OPERATING_STATE, RUN)


class PlantDisplay:
    """What the terminal shows of a simulated robot, and its reset."""

    def __init__(self, node: BallbotNode[GamepadParameters]) -> None:
        self._node = node
        self._newest, self._factor = LatestMessages(node, _TOPICS), RealTimeFactor()
        self._reset = node.create_client(Trigger, f'{PLANT}/reset')

    def lines(self) -> Mapping[str, str]:
        """Return names and texts; called on the keyboard's thread."""
        snapshot, _ = self._newest.take()
        factor = self._factor.update(time.monotonic(), snapshot.time) if snapshot else 0.0
        return drive_status(snapshot, factor)

    def restart(self) -> None:
        """Let the plant begin a new run."""
        self._reset.call_async(Trigger.Request())

    def close(self) -> None:
        """End its subscriptions."""
        self._newest.close()
        self._node.destroy_client(self._reset)


class TeleopTerminal:
    """Drives from the keyboard, until the terminal disappears (`is_closed`).

    Parameters
    ----------
    command : callable
        Returns the input in command, and its sticks.
    lines : callable
        Returns what the panel shows above them, as names and texts.
    on_reset : callable or None
        Called for the reset key; None if the robot has no reset.

    Attributes
    ----------
    on_key : callable
        Called for every key, on the keyboard's thread.
    """

    def __init__(
        self,
        node: BallbotNode[Any],
        sources: Arbiter,
        command: Callable[[], tuple[str, Sticks]],
        lines: Callable[[], Mapping[str, str]],
        on_reset: Callable[[], None] | None = None,
    ) -> None:
        self._node, self._sources, self._command = node, sources, command
        self._lines = lines
        self.is_closed = False
        self.on_key: Callable[[], None] = lambda: None
        # Ignore SIGHUP: a node that loses its terminal loses an input, but must not end.
        signal.signal(signal.SIGHUP, signal.SIG_IGN)
        self._keys = KeyboardSticks(node.parameters.gp_max)
        self._terminal = Terminal(
            self._keys,
            self._status,
            on_sticks=lambda sticks: sources.report(KEYBOARD, sticks, time.monotonic()),
            on_reset=on_reset,
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

    def _on_key(self) -> None:
        self.on_key()

    def _on_closed(self) -> None:
        self._sources.release(KEYBOARD)
        self.is_closed = True

    def _status(self) -> Mapping[str, str]:
        """Return the content of the panel; called on the keyboard's thread."""
        source, (vertical, horizontal) = self._command()
        return {
            **self._lines(),
            'in command': source,
            # The document's vertical stick is negative forward.
            'sticks': f'forward {-vertical:+d}   rightward {horizontal:+d}',
        }
