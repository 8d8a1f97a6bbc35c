"""Pacing of a run against the wall clock."""

from __future__ import annotations

from ballbot_ros.timing import TICK_S


class Pacer:
    """Computes when each tick is due on the wall clock.

    Times are readings of one monotonic clock [s]. A tick that comes more than a period late is
    counted (`late_ticks`); pacing then restarts instead of catching up.
    """

    def __init__(self) -> None:
        self.late_ticks = 0
        self.restart()

    def restart(self) -> None:
        """Restart the pacing with the next tick."""
        self._due_s: float | None = None

    def delay_s(self, factor: float, now_s: float) -> float:
        """Return how long to wait before the next tick at `factor` times real time [s].

        The result is 0 if the tick is due, and always for a factor of 0.
        """
        if factor == 0.0 or self._due_s is None:
            return 0.0
        return max(0.0, self._due_s - now_s)

    def on_tick(self, factor: float, now_s: float) -> None:
        """Note a tick at `now_s`; the next one is due a period later."""
        if factor == 0.0:
            self._due_s = None
            return
        period_s = TICK_S / factor
        due_s = now_s if self._due_s is None else self._due_s
        if now_s - due_s > period_s:
            self.late_ticks += 1
            due_s = now_s
        self._due_s = due_s + period_s
