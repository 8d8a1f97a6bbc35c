"""Observers of a run, for its progress and for notices."""

from __future__ import annotations

import logging
from typing import Protocol


class RunObserver(Protocol):
    """Receives the progress of a run, and notices about it."""

    def update(self, elapsed_s: float) -> None:
        """Show the sim time since the start [s]; called at every tick, so it must be cheap."""
        ...

    def notice(self, text: str) -> None:
        """Show one line to the user, for example that a node has ended."""
        ...


class LogObserver:
    """Logs notices as warnings of the logger ``ballbot_ros.run``, and shows no progress."""

    def __init__(self) -> None:
        self._log = logging.getLogger('ballbot_ros.run')

    def update(self, elapsed_s: float) -> None:
        """Do nothing."""

    def notice(self, text: str) -> None:
        """Log the line."""
        self._log.warning(text)
