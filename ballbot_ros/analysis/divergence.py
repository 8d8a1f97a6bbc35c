"""Difference between the duties of two controllers."""

from __future__ import annotations

import math


class Divergence:
    """Collects pairs of duties, tick by tick.

    Attributes
    ----------
    ticks, differing : int
        Number of ticks, and of ticks in which a duty differs.
    first_ns : int or None
        Sim time of the first difference [ns].
    largest : tuple of int
        Largest absolute difference of planes x and y [%].
    """

    def __init__(self) -> None:
        self.ticks = 0
        self.differing = 0
        self.first_ns: int | None = None
        self.largest = (0, 0)
        self._squares = (0, 0)

    def add(self, stamp_ns: int, one: tuple[int, int], other: tuple[int, int]) -> None:
        """Add the duties of a tick."""
        self.ticks += 1
        if one == other:
            return
        self.differing += 1
        if self.first_ns is None:
            self.first_ns = stamp_ns
        x, y = abs(one[0] - other[0]), abs(one[1] - other[1])
        self.largest = max(self.largest[0], x), max(self.largest[1], y)
        self._squares = self._squares[0] + x * x, self._squares[1] + y * y

    @property
    def rms(self) -> tuple[float, float]:
        """Root mean square of the differences of planes x and y [%]."""
        count = max(1, self.ticks)
        return math.sqrt(self._squares[0] / count), math.sqrt(self._squares[1] / count)
