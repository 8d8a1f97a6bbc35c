"""Formulas of temporal logic over the signals of runs, and how far they are from being violated.

The value of a formula at a tick is its robustness: of a comparison the difference of its sides,
of ``and`` and ``always`` the smallest, of ``or`` and ``eventually`` the largest of what they join,
and ``not`` changes the sign (the quantitative semantics of signal temporal logic, Donzé and Maler
2010). A window is cut at the end of a trace, and may be empty beyond it. Where a signal is NaN, a
formula that needs it is NaN.
"""

from __future__ import annotations

import math
import operator
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from ballbot_ros.robot.arithmetic import Floats

SignalValues: TypeAlias = Callable[[str, int, int], Floats]
"""Returns a signal, given by name, from one tick up to, but not including, another: (r, n)."""


class Trace(NamedTuple):
    """The signals of some runs, up to, but not including, a tick."""

    signals: SignalValues
    end: int


class Value(NamedTuple):
    """A number, a signal by its name, or a function of other values."""

    of: float | str | Callable[..., Any]
    arguments: tuple[Value, ...] = ()

    def values(self, trace: Trace, first: int, last: int) -> Any:
        """Return the values from tick `first` up to, but not including, `last`: (r, n)."""
        if isinstance(self.of, str):
            return trace.signals(self.of, first, last)
        if isinstance(self.of, float):
            return self.of
        return self.of(*(each.values(trace, first, last) for each in self.arguments))

    def bounds(self, ranges: Mapping[str, Interval]) -> Interval:
        """Return an interval that has all values, given those of signals; others have any."""
        if isinstance(self.of, str):
            return ranges.get(self.of, ANY)
        if isinstance(self.of, float):
            return Interval(self.of, self.of)
        if self.of is abs:
            (inner,) = (each.bounds(ranges) for each in self.arguments)
            least = 0.0 if inner.low <= 0.0 <= inner.high else min(map(abs, inner))
            return Interval(least, max(map(abs, inner)))
        left, right = (each.bounds(ranges) for each in self.arguments)
        if self.of is operator.truediv and right.low <= 0.0 <= right.high:
            return ANY
        ends = [self.of(one, other) for one in left for other in right]
        # The product of 0 and an unbounded number, and all that else is unknown.
        known = [0.0 if math.isnan(each) and self.of is operator.mul else each for each in ends]
        return ANY if any(map(math.isnan, known)) else Interval(min(known), max(known))


class Interval(NamedTuple):
    """All numbers from one to another; either end may be infinite."""

    low: float
    high: float


ANY = Interval(-math.inf, math.inf)


class Formula(ABC):
    """What holds or not at each tick of a trace."""

    @abstractmethod
    def values(self, trace: Trace, first: int, last: int) -> Floats:
        """Return the robustness from tick `first` up to, but not including, `last`: (r, n)."""

    @abstractmethod
    def decision(self, trace: Trace, tick: int) -> int | None:
        """Return the tick at which a comparison decides the robustness of the first run at `tick`.

        It is the first of several; None if the windows that decide are empty.
        """

    @abstractmethod
    def bounds(self, ranges: Mapping[str, Interval]) -> Interval:
        """Return an interval that has every robustness, given those of signals.

        It may be too wide: signals are taken as independent of each other.
        """


@dataclass(frozen=True)
class Comparison(Formula):
    """Whether a value is at least another one."""

    larger: Value
    smaller: Value

    def values(self, trace: Trace, first: int, last: int) -> Floats:
        larger = self.larger.values(trace, first, last)
        return np.asarray(larger - self.smaller.values(trace, first, last))

    def decision(self, trace: Trace, tick: int) -> int | None:
        return tick

    def bounds(self, ranges: Mapping[str, Interval]) -> Interval:
        return Value(operator.sub, (self.larger, self.smaller)).bounds(ranges)


@dataclass(frozen=True)
class Negation(Formula):
    """Whether a formula does not hold."""

    formula: Formula

    def values(self, trace: Trace, first: int, last: int) -> Floats:
        return -self.formula.values(trace, first, last)

    def decision(self, trace: Trace, tick: int) -> int | None:
        return self.formula.decision(trace, tick)

    def bounds(self, ranges: Mapping[str, Interval]) -> Interval:
        low, high = self.formula.bounds(ranges)
        return Interval(-high, -low)


@dataclass(frozen=True)
class Both(Formula):
    """Whether two formulas hold."""

    left: Formula
    right: Formula

    def values(self, trace: Trace, first: int, last: int) -> Floats:
        left = self.left.values(trace, first, last)
        return np.minimum(left, self.right.values(trace, first, last))

    def decision(self, trace: Trace, tick: int) -> int | None:
        left, right = (each.values(trace, tick, tick + 1)[0, 0] for each in (self.left, self.right))
        return (self.left if left <= right else self.right).decision(trace, tick)

    def bounds(self, ranges: Mapping[str, Interval]) -> Interval:
        return Interval(*map(min, self.left.bounds(ranges), self.right.bounds(ranges)))


@dataclass(frozen=True)
class Always(Formula):
    """Whether a formula holds from `start` to `end` ticks later; `end` may be infinite."""

    start: int
    end: float
    formula: Formula

    def values(self, trace: Trace, first: int, last: int) -> Floats:
        begin, end, count = first + self.start, int(min(last + self.end, trace.end)), last - first
        if begin >= end:
            return np.full_like(self.formula.values(trace, first, last), math.inf)
        values = self.formula.values(trace, begin, end)
        if count == 1:
            return np.asarray(np.min(values, axis=1, keepdims=True))
        span, width = 1, int(min(self.end - self.start + 1, end - begin))
        if values.shape[1] < count + width - 1:  # cut at the end
            beyond = np.full((len(values), count + width - 1 - values.shape[1]), math.inf)
            values = np.concatenate([values, beyond], axis=1)
        while 2 * span <= width:
            values = np.minimum(values[:, :-span], values[:, span:])
            span *= 2
        # Two windows of this span, which overlap, cover one of any width.
        return np.minimum(values[:, :count], values[:, width - span :][:, :count])

    def decision(self, trace: Trace, tick: int) -> int | None:
        begin, end = tick + self.start, int(min(tick + 1 + self.end, trace.end))
        if begin >= end:
            return None
        place = int(np.argmin(self.formula.values(trace, begin, end)[0]))
        return self.formula.decision(trace, begin + place)

    def bounds(self, ranges: Mapping[str, Interval]) -> Interval:
        return Interval(self.formula.bounds(ranges).low, math.inf)  # that of an empty window


def negation(formula: Formula) -> Formula:
    """Return the formula that holds if another one does not."""
    if isinstance(formula, Comparison):
        return Comparison(formula.smaller, formula.larger)
    return formula.formula if isinstance(formula, Negation) else Negation(formula)


def either(left: Formula, right: Formula) -> Formula:
    """Return the formula that holds if one of two does."""
    return Negation(Both(negation(left), negation(right)))


def eventually(start: int, end: float, formula: Formula) -> Formula:
    """Return the formula that holds if another one does at a tick of a window."""
    return Negation(Always(start, end, negation(formula)))


@dataclass(frozen=True)
class Until(Formula):
    """Whether a formula holds up to `end` ticks later, and another one at all ticks before."""

    end: float
    before: Formula
    then: Formula

    def values(self, trace: Trace, first: int, last: int) -> Floats:
        end = int(min(last + self.end, trace.end))
        held, reached = (each.values(trace, first, end) for each in (self.before, self.then))
        left, span = int(min(self.end + 1, end - first)), 1
        while span < left:
            # A window is two that may overlap: the second counts while `before` holds in the first.
            step = min(span, left - span)
            reached = np.maximum(reached, np.minimum(held, _ahead(reached, step, -math.inf)))
            held = np.minimum(held, _ahead(held, step, math.inf))
            span += step
        return reached[:, : last - first]

    def decision(self, trace: Trace, tick: int) -> int | None:
        end = int(min(tick + 1 + self.end, trace.end))
        before, then = (each.values(trace, tick, end)[0] for each in (self.before, self.then))
        held = np.concatenate([[math.inf], np.minimum.accumulate(before)[:-1]])
        place = int(np.argmax(np.minimum(then, held)))
        if then[place] <= held[place]:
            return self.then.decision(trace, tick + place)
        return self.before.decision(trace, tick + int(np.argmin(before[:place])))

    def bounds(self, ranges: Mapping[str, Interval]) -> Interval:
        return self.then.bounds(ranges)


def _ahead(values: Floats, ticks: int, otherwise: float) -> Floats:
    """Return the values some ticks later, (r, n), and `otherwise` beyond the last."""
    later = np.full_like(values, otherwise)
    later[:, : values.shape[1] - ticks] = values[:, ticks:]
    return later


FUNCTIONS: dict[str, Callable[..., Any]] = {
    '+': operator.add,
    '-': operator.sub,
    '*': operator.mul,
    '/': operator.truediv,
    'abs': abs,
}
"""Functions of values."""
