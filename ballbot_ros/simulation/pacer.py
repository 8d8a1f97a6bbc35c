"""Keeps a run in step with the wall clock."""

from __future__ import annotations

import time

from ballbot_ros.simulation.timing import TICK_NS

SLOWEST = 0.01
"""The smallest factor: a tick then takes 0.4 s, in which the plant answers nobody."""


class Pacer:
    """Delays each tick until the wall clock has reached it.

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

    def wait(self, factor: float) -> None:
        """Wait until the next tick is due at `factor` times real time; 0 never waits."""
        if factor == 0.0:
            self._due = None
            return
        period = TICK_NS * 1e-9 / factor
        now = time.monotonic()
        if self._due is None:
            self._due = now
        ahead = self._due - now
        if ahead > 0.0:
            time.sleep(ahead)
        elif ahead < -period:
            self.late += 1
            self._due = now
        self._due += period
