"""Keeps a run in step with the wall clock."""

from __future__ import annotations

import time

from ballbot_ros.simulation.timing import TICK_NS


class Pacer:
    """Tells when each tick is due on the wall clock.

    Attributes
    ----------
    late : int
        Ticks that came more than a period late; pacing then begins anew instead of hurrying.
    """

    def __init__(self) -> None:
        self.late = 0
        self.restart()

    def restart(self) -> None:
        """Begin pacing from now on."""
        self._due: float | None = None

    def delay_s(self, factor: float) -> float:
        """Return how long [s] the next tick has to wait at `factor` times real time.

        It is 0 where the tick is due, and always at a factor of 0.
        """
        if factor == 0.0 or self._due is None:
            return 0.0
        return max(0.0, self._due - time.monotonic())

    def ticked(self, factor: float) -> None:
        """Note that the tick is made now; the next one follows a period later."""
        if factor == 0.0:
            self._due = None
            return
        period = TICK_NS * 1e-9 / factor
        now = time.monotonic()
        due = now if self._due is None else self._due
        if now - due > period:
            self.late += 1
            due = now
        self._due = due + period

    def wait(self, factor: float) -> None:
        """Sleep until the next tick is due, and make it; not for a callback."""
        if delay_s := self.delay_s(factor):
            time.sleep(delay_s)
        self.ticked(factor)
