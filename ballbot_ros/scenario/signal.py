"""Stick signals: straight lines between points of time (the document's Signal Builder)."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass

from ballbot_ros.brick.units import quantise


@dataclass(frozen=True)
class Signal:
    """A piecewise linear signal; two points at one time are a step.

    Attributes
    ----------
    points : sequence of (float, float)
        Times [s], never decreasing, and values. Before the first point the signal is zero,
        after the last it keeps the last value.
    """

    points: Sequence[tuple[float, float]] = ()

    def at(self, time: float) -> int:
        """Return the value at `time` [s], rounded to a whole number."""
        index = bisect_right(self.points, time, key=lambda point: point[0])
        if index == 0:
            return 0
        t0, v0 = self.points[index - 1]
        if index == len(self.points):
            return quantise(v0)
        t1, v1 = self.points[index]
        return quantise(v0 + (v1 - v0) * (time - t0) / (t1 - t0))
