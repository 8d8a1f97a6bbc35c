"""Observers of a run: of its progress, and of incidents in it."""

from __future__ import annotations

import logging
from typing import Protocol

UPDATE_S = 0.2
"""How often a progress display changes, in wall time [s]."""


class RunObserver(Protocol):
    """Takes the progress of a run, and what happens in it."""

    def update(self, elapsed_s: float) -> None:
        """Take the sim time since the start [s]; called at every tick, so it has to be cheap."""
        ...

    def notice(self, text: str) -> None:
        """Take one line for the user, such as that a node has ended."""
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
