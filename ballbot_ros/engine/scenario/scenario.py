"""A scenario: start state, events and expectations of a run."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import KW_ONLY, dataclass, field
from functools import cached_property
from itertools import pairwise
from typing import Any, NamedTuple, overload

import numpy as np
from numpy.typing import NDArray

from ballbot_ros.engine.scenario.properties import Events, Property
from ballbot_ros.parameters import ParameterSet
from ballbot_ros.robot.arithmetic import sine_cosine
from ballbot_ros.robot.brick.faults import Fault
from ballbot_ros.robot.brick.sensors import quantise
from ballbot_ros.robot.plant.ground_truth import Pair, Push


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


class Measure(NamedTuple):
    """A metric of a run, or of the part of it from `start` to `end` [s]."""

    metric: str
    start: float = 0.0
    end: float = math.inf


@dataclass(frozen=True)
class Expectation:
    """Inclusive bounds, or None for no bound, on a metric of a run or of a part of it.

    The measured window, `start` to `end` [s], counts from the start of the run.
    """

    metric: str
    minimum: float | None = None
    maximum: float | None = None
    start: float = 0.0
    end: float = math.inf

    @property
    def measure(self) -> Measure:
        """What is measured."""
        return Measure(self.metric, self.start, self.end)

    @overload
    def holds(self, value: float) -> bool: ...
    @overload
    def holds(self, value: NDArray[np.float64]) -> NDArray[np.bool_]: ...
    def holds(self, value: Any) -> Any:
        """Return whether `value`, or each of an array, is within the bounds; NaN never is."""
        low = self.minimum is None or value >= self.minimum
        high = self.maximum is None or value <= self.maximum
        return low & high & (value == value)

    @property
    def covers_whole_run(self) -> bool:
        """Whether the measured window is the whole run."""
        return self.start == 0.0 and self.end == math.inf

    @property
    def window(self) -> str:
        """The window as text, empty for the whole run."""
        if self.covers_whole_run:
            return ''
        return f'{self.start:g} s to ' + ('the end' if self.end == math.inf else f'{self.end:g} s')

    def __str__(self) -> str:
        """Return the bounds as text."""
        return bounds_text(self.minimum, self.maximum)


def bounds_text(minimum: float | None, maximum: float | None) -> str:
    """Return bounds as text, as in ``≥ 1``, ``≤ 2`` or ``1 … 2``; '' without a bound."""
    if minimum is not None and maximum is not None:
        return f'{minimum:g} … {maximum:g}'
    if minimum is not None:
        return f'≥ {minimum:g}'
    return '' if maximum is None else f'≤ {maximum:g}'


PUSH_DIRECTIONS = {
    'forward': (1.0, 0.0),
    'backward': (-1.0, 0.0),
    'left': (0.0, -1.0),
    'right': (0.0, 1.0),
}
"""Unit vectors in plane signs: forward, rightward."""


@dataclass(frozen=True)
class ScheduledPush:
    """A push in a scenario.

    Attributes
    ----------
    time, duration : float
        From the start of the run [s].
    force : float or tuple of float
        Its magnitude [N], or the forces on planes x and y [N], in plane signs.
    direction : str or float
        One of :data:`PUSH_DIRECTIONS`, or an angle [deg], counterclockwise from forward (REP 103);
        without a meaning for the forces on both planes.
    torque : tuple of float
        Torques [N·m] that tip planes x and y.
    """

    time: float
    duration: float
    _: KW_ONLY
    force: float | Pair = 0.0
    direction: str | float = 'forward'
    torque: Pair = (0.0, 0.0)

    @property
    def components(self) -> Pair:
        """The forces on planes x and y [N], in plane signs."""
        if isinstance(self.force, tuple):
            return self.force
        if isinstance(self.direction, str):
            forward, rightward = PUSH_DIRECTIONS[self.direction]
        else:
            # Plane y is positive to the right.
            sine, forward = sine_cosine(math.radians(self.direction))
            rightward = -sine
        return self.force * forward, self.force * rightward


@dataclass(frozen=True)
class Scenario:
    """A scenario, as read from its file.

    Attributes
    ----------
    name, purpose : str
        Name of the file, and one line on the purpose.
    profile : str
        ``ideal`` or ``hardware``.
    parameters : ParameterSet
        The values that the scenario sets, including duration and start state.
    vertical, horizontal : StickSignal
        The sticks in packet units: -100 is up, forward; +100 is right.
    faults : tuple of Fault
        Those of the key `faults`; the run has those of its parameters.
    text : str
        Text of the file, for the recording.
    """

    name: str = ''
    purpose: str = ''
    profile: str = 'ideal'
    parameters: ParameterSet = field(default_factory=ParameterSet)
    vertical: StickSignal = field(default_factory=StickSignal)
    horizontal: StickSignal = field(default_factory=StickSignal)
    pushes: tuple[ScheduledPush, ...] = ()
    faults: tuple[Fault, ...] = ()
    expectations: tuple[Expectation, ...] = ()
    properties: tuple[Property, ...] = ()
    text: str = ''

    @property
    def segments(self) -> tuple[Segment, ...]:
        """The segments of both stick signals."""
        return (*self.vertical.segments, *self.horizontal.segments)

    @property
    def events(self) -> Events:
        """What happens in its runs, for properties: after a push has ended, after a fault began."""
        return {
            'push': sorted((each.time, each.time + each.duration) for each in self.pushes),
            'fault': sorted((each.time, each.time) for each in self.faults),
        }

    def sticks_at(self, time: float) -> tuple[int, int]:
        """Return the sticks (vertical, horizontal) at `time` [s] from the start of the run."""
        return self.vertical.at(time), self.horizontal.at(time)

    def pushes_from(self, start_ns: int) -> list[Push]:
        """Return the pushes of a run that begins at sim time `start_ns`."""
        return [
            Push(
                start_ns + round(push.time * 1e9),
                start_ns + round((push.time + push.duration) * 1e9),
                push.components,
                push.torque,
            )
            for push in self.pushes
        ]


def push_fault(pushes: Sequence[ScheduledPush], duration: float) -> tuple[int, str] | None:
    """Return the index of the first push that a run of `duration` [s] can't have, and why."""
    for index, push in enumerate(pushes):
        if push.time >= duration:
            return index, 'a push begins after the end of the run'
    return None
