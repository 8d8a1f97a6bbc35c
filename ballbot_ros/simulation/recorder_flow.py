"""Flow control between plant and recorder: how far the plant may run ahead."""

from __future__ import annotations

from ballbot_ros.simulation.participants import Participant
from ballbot_ros.timing import MAX_LEAD_TICKS, SLOW_PERIOD_NS, TICK_NS


class RecorderFlow:
    """Holds the plant back until the recorder has caught up.

    The topics keep nothing for late subscribers. Therefore the plant waits until the recorder has
    completely received the first tick, and each tick that was sent again.

    Attributes
    ----------
    ack_ns : int or None
        The newest tick that it has acknowledged [ns].
    """

    def __init__(self, start_ns: int) -> None:
        self.recorder: Participant | None = None
        self.ack_ns: int | None = None
        self._newest: Participant | None = None
        self._sync_ns = start_ns

    def begin(self, recorder: Participant | None) -> None:
        """Begin the run with the recorder that has joined it, if any."""
        self.recorder = self._newest = recorder

    def join(self, recorder: Participant | None, now_ns: int) -> bool:
        """Accept a recorder that joins in mid-run; return whether one has.

        The recorder starts at a tick at which every driver sends a sample.
        """
        if recorder == self._newest:
            return False
        self.recorder = self._newest = recorder
        self.ack_ns = None
        self._sync_ns = -(-now_ns // SLOW_PERIOD_NS) * SLOW_PERIOD_NS
        return True

    def leave(self) -> None:
        """Continue without a recorder."""
        self.recorder = self.ack_ns = None

    def require_ack(self, now_ns: int) -> None:
        """Note that a tick was sent again at sim time `now_ns` [ns]."""
        # Wait for the recorder, which may not have discovered yet a participant that has only just
        # answered.
        if self.ack_ns is not None:
            self._sync_ns = now_ns

    def lags(self, now_ns: int) -> bool:
        """Return whether the recorder must catch up before the tick at `now_ns` [ns] ends."""
        if self.recorder is None:
            return False
        if self.ack_ns is None or self.ack_ns < self._sync_ns:
            return now_ns >= self._sync_ns
        return now_ns - self.ack_ns > MAX_LEAD_TICKS * TICK_NS

    def has_all(self, last_ns: int) -> bool:
        """Return whether the recorder has everything up to the last tick [ns]."""
        if self.recorder is None:
            return True
        if self.ack_ns is None:
            return self._sync_ns > last_ns
        return self.ack_ns >= last_ns

    @property
    def next_ns(self) -> int | None:
        """The first tick that the recorder lacks [ns]; None before its first acknowledgement."""
        if self.recorder is None or self.ack_ns is None:
            return None
        return self.ack_ns + TICK_NS
