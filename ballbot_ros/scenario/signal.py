"""Stick signals: named steps and straight lines in time (the document's Signal Builder)."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass

from ballbot_ros.brick.units import quantise


@dataclass(frozen=True)
class Segment:
    """A part of a signal, with a name for pictures.

    Its points are two or more times [s], never decreasing, and values, joined by straight lines;
    two points at one time are a step.
    """

    name: str
    points: Sequence[tuple[float, float]]

    @property
    def start(self) -> float:
        """Time of the first point [s]."""
        return self.points[0][0]

    @property
    def end(self) -> float:
        """Time of the last point [s]; infinite for an open segment."""
        return self.points[-1][0]

    def at(self, time: float) -> int:
        """Return the value at `time` [s] in [start, end), rounded to a whole number."""
        index = bisect_right(self.points, time, key=lambda point: point[0])
        (t0, v0), (t1, v1) = self.points[index - 1], self.points[index]
        # Do not interpolate between equal values: the time of the second may be infinite.
        return quantise(v0 if v0 == v1 else v0 + (v1 - v0) * (time - t0) / (t1 - t0))


@dataclass(frozen=True)
class StickSignal:
    """A stick's signal: its segments, in order of time without overlap, and neutral in between."""

    segments: Sequence[Segment] = ()

    def at(self, time: float) -> int:
        """Return the value at `time` [s], rounded to a whole number."""
        index = bisect_right(self.segments, time, key=lambda segment: segment.start)
        if index == 0 or time >= self.segments[index - 1].end:
            return 0
        return self.segments[index - 1].at(time)
