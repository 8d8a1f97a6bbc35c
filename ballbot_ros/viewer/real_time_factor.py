"""The real-time factor of the run that is shown."""

from __future__ import annotations

SPAN_S = 1.0
"""Wall time over which the factor is measured."""


class RealTimeFactor:
    """Sim time per wall time, over the last :data:`SPAN_S` of wall time."""

    def __init__(self) -> None:
        self._ticks: list[tuple[float, float]] = []

    def update(self, now_s: float, sim_time: float) -> float:
        """Return the factor at `now_s` on a monotonic clock [s]; 0 without an earlier sample."""
        if self._ticks and sim_time < self._ticks[-1][1]:
            self._ticks.clear()  # another run, or a player that has jumped back
        self._ticks.append((now_s, sim_time))
        while now_s - self._ticks[0][0] > SPAN_S:
            self._ticks.pop(0)
        wall, sim = self._ticks[0]
        return (sim_time - sim) / (now_s - wall) if now_s > wall else 0.0
