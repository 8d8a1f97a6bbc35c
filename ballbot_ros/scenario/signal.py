"""Stick signals: named steps and straight lines in time (the document's Signal Builder)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

from ballbot_ros.brick.units import quantise


@dataclass(frozen=True)
class Segment:
    """A part of a signal, with a name for pictures.

    Its points are two or more times [s], never decreasing, and values, joined by straight lines;
    two points at one time are a step.
    """

    name: str
    points: Sequence[tuple[float, float]]

    @classmethod
    def step(cls, name: str, start: float, end: float, value: float) -> Segment:
        """Return a segment of one value from `start` to `end` [s]."""
        return cls(name, ((start, value), (end, value)))

    @property
    def is_step(self) -> bool:
        """Whether it has one value, between two points."""
        return len(self.points) == 2 and self.points[0][1] == self.points[1][1]

    @property
    def start(self) -> float:
        """Time of the first point [s]."""
        return self.points[0][0]

    @property
    def end(self) -> float:
        """Time of the last point [s]; infinite for an open segment."""
        return self.points[-1][0]


def signal_value(times: Sequence[float], values: Sequence[float], time: float) -> int:
    """Return the value at `time` [s] of the straight lines between points; 0 outside.

    It is rounded to a whole number. The times of the points [s] never decrease.
    """
    # The number of points up to `time`, by bisection.
    low, high = 0, len(times)
    while low < high:
        middle = (low + high) // 2
        if times[middle] <= time:
            low = middle + 1
        else:
            high = middle
    if low == 0 or low == len(times):
        return 0
    t0, t1 = times[low - 1], times[low]
    v0, v1 = values[low - 1], values[low]
    # Do not interpolate between equal values: the time of the second may be infinite.
    return quantise(v0 if v0 == v1 else v0 + (v1 - v0) * (time - t0) / (t1 - t0))


@dataclass(frozen=True)
class StickSignal:
    """A stick's signal: its segments, in order of time without overlap, and neutral in between."""

    segments: Sequence[Segment] = ()

    @cached_property
    def points(self) -> tuple[Sequence[float], Sequence[float]]:
        """Times [s] and values of the points of all segments, with zeros in between."""
        points: list[tuple[float, float]] = []
        for each in self.segments:
            points += ((each.start, 0.0), *each.points, (each.end, 0.0))
        return [time for time, _ in points], [value for _, value in points]

    def at(self, time: float) -> int:
        """Return the value at `time` [s], rounded to a whole number."""
        times, values = self.points
        return signal_value(times, values, time)


def segment_fault(segments: Sequence[Segment], duration: float) -> tuple[int, str] | None:
    """Return the index of the first segment that a run of `duration` [s] can't have, and why."""
    for index, segment in enumerate(segments):
        if segment.start >= duration:
            return index, f'{segment.name!r} begins after the end of the run'
    for index, (before, after) in enumerate(pairwise(segments), 1):
        if after.start < before.end:
            last = 'the end' if before.end == math.inf else f'{before.end:g} s'
            return index, (
                f'time goes back: {after.name!r} begins at {after.start:g} s, '
                f'{before.name!r} lasts until {last}'
            )
    return None
