"""Detects the ticks of a run that the recorder has received completely."""

from __future__ import annotations

from collections.abc import Iterable

from ballbot_ros.simulation.recording_gate import Stream


class RecordedTicks:
    """Tracks the streams that a run requires, and detects complete ticks.

    `acked_ns` is the newest tick reported as complete [ns], 0 before the first.
    """

    def __init__(self) -> None:
        self.begin()

    def begin(self) -> None:
        """Start over with another plant, whose run requires nothing yet."""
        self.acked_ns = 0
        self._required: tuple[Stream, ...] = ()

    def require(self, streams: Iterable[Stream]) -> None:
        """Set the streams of a run: a tick is complete when each of them has its sample."""
        self._required = tuple(streams)

    def advance(self) -> bool:
        """Return whether a newer tick is complete; if so, `acked_ns` is that tick."""
        complete_ns = min((stream.complete_ns for stream in self._required), default=0)
        if complete_ns <= self.acked_ns:
            return False
        self.acked_ns = complete_ns
        return True
