"""Keeps a run in step with the wall clock."""

from __future__ import annotations

from ballbot_ros.timing import SECOND_NS, TICK_NS


class Pacer:
    """Tells when each tick is due on the wall clock.

    Times are readings of one clock that only goes forward [s].

    Attributes
    ----------
    late_ticks : int
        Ticks that came more than a period late; pacing then starts over instead of hurrying.
    """

    def __init__(self) -> None:
        self.late_ticks = 0
        self.restart()

    def restart(self) -> None:
        """Start over with the next tick."""
        self._due_s: float | None = None

    def delay_s(self, factor: float, now_s: float) -> float:
        """Return how long the next tick has to wait at `factor` times real time [s].

        It is 0 if the tick is due, and always at a factor of 0.
        """
        if factor == 0.0 or self._due_s is None:
            return 0.0
        return max(0.0, self._due_s - now_s)

    def ticked(self, factor: float, now_s: float) -> None:
        """Note a tick at `now_s`; the next one is due a period later."""
        if factor == 0.0:
            self._due_s = None
            return
        period_s = TICK_NS / SECOND_NS / factor
        due_s = now_s if self._due_s is None else self._due_s
        if now_s - due_s > period_s:
            self.late_ticks += 1
            due_s = now_s
        self._due_s = due_s + period_s
