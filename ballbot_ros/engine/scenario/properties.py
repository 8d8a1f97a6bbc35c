"""Properties: what runs shall do over time, judged by the signals of the true motion and others.

A property counts from the release, the end of `hold_time`, to the last tick; its scopes select
parts of the run. In each part its formula must hold at the first tick, and sees no later tick than
the last of the part.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ballbot_ros.engine.scenario.formulas import Formula, SignalValues, Trace
from ballbot_ros.parameters.timing import SECOND_NS, TICK_NS, TICK_S
from ballbot_ros.robot.arithmetic import Floats
from ballbot_ros.robot.world.clearance import NO_WALLS, Walls, clearance


class Part(NamedTuple):
    """The part of a run from one tick up to, but not including, another."""

    first: int
    last: int


Events: TypeAlias = Mapping[str, Sequence[tuple[float, float]]]
"""By kind: when each event begins, and when what is after it [s], in order of time."""


class Course(NamedTuple):
    """What scopes need to know of a run: its events, of some `EVENTS`, and drive mode."""

    events: Events
    mode: str


EVENTS = 'push', 'fault'
DRIVE_MODES = 'remote', 'autonomous'


class Scope(NamedTuple):
    """Which parts of a run count.

    Attributes
    ----------
    word : str
        ``after`` or ``until`` an event, ``while`` in a drive mode, or ``from`` a time.
    subject : str
        The kind of event, or the drive mode.
    number : int
        Which event of the kind, from 1; 0 for each.
    start, end : float
        The times [s].
    """

    word: str
    subject: str = ''
    number: int = 0
    start: float = 0.0
    end: float = math.inf

    def parts(self, whole: Part, course: Course) -> list[Part]:
        """Return the parts of a part of a run; some may be empty."""
        if self.word == 'while':
            return [whole] if course.mode == self.subject else []
        if self.word == 'from':
            last = whole.last if self.end == math.inf else last_tick(self.end) + 1
            return [Part(max(whole.first, first_tick(self.start)), min(whole.last, last))]
        events = course.events.get(self.subject, ())
        chosen = events[self.number - 1 : self.number] if self.number else events
        if self.word == 'after':
            return [Part(max(whole.first, first_tick(end)), whole.last) for _, end in chosen]
        return [Part(whole.first, min([whole.last, *(first_tick(each) for each, _ in chosen)]))]


def first_tick(seconds: float) -> int:
    """Return the first tick at or after a time [s] from the start of the run."""
    return -(-round(seconds * SECOND_NS) // TICK_NS)


def last_tick(seconds: float) -> int:
    """Return the last tick at or before a time [s] from the start of the run."""
    return round(seconds * SECOND_NS) // TICK_NS


@dataclass(frozen=True)
class Property:
    """A property of a scenario.

    Attributes
    ----------
    name, text : str
        As in the file.
    scopes : tuple of Scope
        Each selects parts of those before.
    horizon : float
        The number of later ticks on which the robustness at a tick depends; may be infinite.
    unit : str
        Unit of its robustness; '' for a pure number.
    signals : tuple of str
        The signals that it needs.
    """

    name: str
    text: str
    scopes: tuple[Scope, ...]
    formula: Formula
    horizon: float
    unit: str
    signals: tuple[str, ...]

    def parts(self, hold_time: float, ticks: int, course: Course) -> list[Part]:
        """Return the parts that count of a run of some ticks, released at `hold_time` [s]."""
        # As of metrics, the first tick is the one next to the release.
        parts = [Part(last_tick(hold_time + TICK_S / 2), ticks)]
        for scope in self.scopes:
            parts = [part for each in parts for part in scope.parts(each, course)]
        return [each for each in parts if each.first < each.last]

    def robustness(self, signals: SignalValues, parts: Sequence[Part]) -> Floats:
        """Return how far runs are from violating the property, (r,); infinite without parts.

        It is negative if they violate it, and NaN if a signal is, or if a part is too short for its
        windows. All runs have the same parts. It raises MissingSignalError if they lack a signal.
        """
        least: Floats = np.full(1, math.nan if self.shortage(parts) else math.inf)
        with np.errstate(all='ignore'):  # a quotient of zeros is NaN
            for first, last in parts:
                found = self.formula.values(Trace(signals, last), first, first + 1)
                least = np.minimum(least, found[:, 0])
        return least

    def shortage(self, parts: Sequence[Part]) -> str:
        """Return that a part is too short for the windows of the property; '' if none is."""
        for first, last in parts:
            if last < first + self.horizon < math.inf:
                begin, ahead, end = (each * TICK_S for each in (first, self.horizon, last))
                return f'it looks {ahead:g} s ahead from {begin:g} s, but that ends at {end:g} s'
        return ''

    def decision(self, signals: SignalValues, parts: Sequence[Part]) -> int | None:
        """Return the tick of a single run that decides its robustness; None if there is none."""
        each = [self.robustness(signals, [part])[0] for part in parts]
        if not parts or np.isnan(each).any():
            return None
        first, last = parts[int(np.argmin(each))]
        with np.errstate(all='ignore'):
            return self.formula.decision(Trace(signals, last), first)

    def fault(self, events: Events, *, has_map: bool) -> str:
        """Return why the property is not possible in a scenario; '' if it is."""
        if CLEARANCE in self.signals and not has_map:
            return f'{CLEARANCE} needs a map'
        for scope in self.scopes:
            count = len(events.get(scope.subject, ()))
            if scope.number > max(count, scope.word == 'until'):
                return f'{scope.subject} {scope.number}: the scenario has {count or "none"}'
        return ''


class MissingSignalError(Exception):
    """A run lacks a signal; the text says which and why."""


CLEARANCE = 'wall_clearance_m'
_CLEARANCE_STRIDE = 5
OF_MOTION = {
    f'{name}_{plane}_{unit}': (name, axis)
    for name, unit in (
        ('position', 'm'),
        ('speed', 'm_per_s'),
        ('pitch', 'deg'),
        ('duty', 'percent'),
    )
    for axis, plane in enumerate('xy')
} | {CLEARANCE: ('clearance', 0)}
"""The signals that follow from the true motion, the duties and the map: what they are, and axes."""


class MotionSignals(NamedTuple):
    """The signals of runs, from the true motion and the duties.

    Attributes
    ----------
    time : ndarray, shape (n,)
        Time since the first tick [s].
    position, psi, duty : ndarray, shape (r, n, 2)
        As in :class:`~ballbot_ros.engine.trajectory.Trajectory`.
    other : callable
        Returns another signal by name, (r, n), or raises MissingSignalError.
    walls : Walls
        The walls around the body, for its clearance, which is that of every fifth tick.
    """

    time: Floats
    position: Floats
    psi: Floats
    duty: Floats | NDArray[np.int8]
    other: Callable[[str], Floats]
    walls: Walls = NO_WALLS

    def of_runs(self, runs: list[int]) -> MotionSignals:
        """Return the signals of some of the runs, in their order."""
        # A slice copies nothing.
        first, last = runs[0], runs[-1] + 1
        chosen: Any = slice(first, last) if last - first == len(runs) else runs
        position, psi, duty = self.position[chosen], self.psi[chosen], self.duty[chosen]

        def other(name: str) -> Floats:
            return np.asarray(self.other(name)[chosen])

        return MotionSignals(self.time, position, psi, duty, other, self.walls)

    def values(self, name: str, first: int, last: int) -> Floats:
        """Return a signal, by name, from tick `first` up to, but not including, `last`: (r, n)."""
        kind, axis = OF_MOTION.get(name, (name, 0))
        if kind == 'pitch':
            return np.asarray(np.degrees(self.psi[:, first:last, axis]))
        if kind == 'position':
            return self.position[:, first:last, axis]
        if kind == 'duty':
            return self.duty[:, first:last, axis].astype(np.float64)
        if kind == 'speed':
            return self._speed(first, last, axis)
        if kind == 'clearance':
            return self._clearance(first, last)
        return self.other(name)[:, first:last]

    def _speed(self, first: int, last: int, axis: int) -> Floats:
        """Return the speed [m/s] from tick to tick, NaN at the first of the run."""
        begin = max(first - 1, 0)
        speed = np.full((len(self.position), last - begin), math.nan)
        steps = np.diff(self.position[:, begin:last, axis], axis=1)
        speed[:, 1:] = steps / np.diff(self.time[begin:last])
        return speed[:, first - begin :]

    def _clearance(self, first: int, last: int) -> Floats:
        if not self.walls.distance.size:
            raise MissingSignalError(f'{CLEARANCE} needs a map with walls')
        skipped = first % _CLEARANCE_STRIDE
        places = self.position[:, first - skipped : last : _CLEARANCE_STRIDE]
        found = clearance(self.walls, places.reshape(-1, 2)).reshape(places.shape[:2])
        return np.repeat(found, _CLEARANCE_STRIDE, axis=1)[:, skipped : skipped + last - first]
