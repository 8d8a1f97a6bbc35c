"""Observers of a run, for its progress and for notices."""

from __future__ import annotations

import logging
from collections.abc import Callable
from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from ballbot_ros.nodes.teleop.terminal import KeyPress


class RunObserver(Protocol):
    """Receives the progress of a run, and notices about it."""

    def update(self, elapsed_s: float) -> None:
        """Show the sim time since the start [s]; called often, so it must be cheap."""

    def notice(self, text: str) -> None:
        """Show one line to the user, for example that a node has ended."""


class LogObserver:
    """Logs notices as warnings of the logger ``ballbot_ros.run``, and shows no progress."""

    def update(self, elapsed_s: float) -> None:
        """Do nothing."""

    def notice(self, text: str) -> None:
        """Log the line."""
        logging.getLogger('ballbot_ros.run').warning(text)


class StartObserver:
    """Passes on what it is told; once the run has started, no longer waits for a key.

    `while_waiting` is called at each update before that.
    """

    def __init__(
        self,
        observer: RunObserver,
        key_press: KeyPress,
        while_waiting: Callable[[], None] = lambda: None,
    ) -> None:
        self._observer, self._key_press, self._while_waiting = observer, key_press, while_waiting
        self.notice = observer.notice

    def update(self, elapsed_s: float) -> None:
        """Show the sim time since the start [s]."""
        if elapsed_s:
            self._key_press.close()
        else:
            self._while_waiting()
        self._observer.update(elapsed_s)
