"""Which ticks of a run the recorder has completely."""

from __future__ import annotations

from collections.abc import Iterable

from ballbot_ros.simulation.recording_gate import Stream


class RecordedTicks:
    """Follows the streams that a run requires, and tells when another tick is complete.

    Attributes
    ----------
    acked_ns : int
        The newest tick that was told to be complete [ns]; 0 before the first.
    """

    def __init__(self) -> None:
        self.begin()

    def begin(self) -> None:
        """Begin with another plant, whose run requires nothing yet."""
        self.acked_ns = 0
        self._required: tuple[Stream, ...] = ()

    def require(self, streams: Iterable[Stream]) -> None:
        """Take what the run requires: a tick is complete when it is in each of these streams."""
        self._required = tuple(streams)

    def advance(self) -> bool:
        """Return whether a newer tick has become complete; it is then :attr:`acked_ns`."""
        complete_ns = min((stream.complete_ns for stream in self._required), default=0)
        if complete_ns <= self.acked_ns:
            return False
        self.acked_ns = complete_ns
        return True
