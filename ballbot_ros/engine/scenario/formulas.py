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
from collections.abc import Callable
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


@dataclass(frozen=True)
class Negation(Formula):
    """Whether a formula does not hold."""

    formula: Formula

    def values(self, trace: Trace, first: int, last: int) -> Floats:
        return -self.formula.values(trace, first, last)

    def decision(self, trace: Trace, tick: int) -> int | None:
        return self.formula.decision(trace, tick)


class Choice(NamedTuple):
    """Which of several values counts: the smallest, or else the largest."""

    is_smallest: bool

    @property
    def neutral(self) -> float:
        """What never counts next to another value."""
        return math.inf if self.is_smallest else -math.inf

    def of_two(self, one: Any, other: Any) -> Any:
        """Return what counts of two arrays, element by element."""
        return np.minimum(one, other) if self.is_smallest else np.maximum(one, other)

    def place(self, values: Any) -> int:
        """Return the first place of what counts."""
        return int(np.argmin(values) if self.is_smallest else np.argmax(values))


SMALLEST, LARGEST = Choice(True), Choice(False)


@dataclass(frozen=True)
class Join(Formula):
    """Whether both formulas hold, or one of them."""

    choice: Choice
    left: Formula
    right: Formula

    def values(self, trace: Trace, first: int, last: int) -> Floats:
        left, right = (each.values(trace, first, last) for each in (self.left, self.right))
        return np.asarray(self.choice.of_two(left, right))

    def decision(self, trace: Trace, tick: int) -> int | None:
        both = self.left, self.right
        place = self.choice.place([each.values(trace, tick, tick + 1)[0, 0] for each in both])
        return both[place].decision(trace, tick)


@dataclass(frozen=True)
class Sometime(Formula):
    """Whether a formula holds at all ticks of a window, or at one of them.

    The window has the ticks from `start` to `end` after a tick; `end` may be infinite.
    """

    choice: Choice
    start: int
    end: float
    formula: Formula

    def values(self, trace: Trace, first: int, last: int) -> Floats:
        begin, end = first + self.start, int(min(last + self.end, trace.end))
        if begin >= end:
            return np.full_like(self.formula.values(trace, first, last), self.choice.neutral)
        values = self.formula.values(trace, begin, end)
        if last - first == 1:
            choose = np.min if self.choice.is_smallest else np.max
            return np.asarray(choose(values, axis=1, keepdims=True))
        span, width = 1, int(min(self.end - self.start + 1, end - begin))
        if values.shape[1] < last - first + width - 1:  # cut at the end
            whole = np.full((len(values), last - first + width - 1), self.choice.neutral)
            whole[:, : values.shape[1]] = values
            values = whole
        while 2 * span <= width:
            values = self.choice.of_two(values[:, :-span], values[:, span:])
            span *= 2
        # Two windows of this span, which overlap, cover one of any width.
        later = values[:, width - span :][:, : last - first]
        return np.asarray(self.choice.of_two(values[:, : last - first], later))

    def decision(self, trace: Trace, tick: int) -> int | None:
        begin, end = tick + self.start, int(min(tick + 1 + self.end, trace.end))
        if begin >= end:
            return None
        place = self.choice.place(self.formula.values(trace, begin, end)[0])
        return self.formula.decision(trace, begin + place)


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


def _ahead(values: Floats, ticks: int, otherwise: float) -> Floats:
    """Return the values some ticks later, (r, n), and `otherwise` beyond the last."""
    later = np.full_like(values, otherwise)
    later[:, : values.shape[1] - ticks] = values[:, ticks:]
    return later


def _smaller(one: Any, other: Any) -> Any:
    are_numbers = isinstance(one, float) and isinstance(other, float)
    return min(one, other) if are_numbers else np.minimum(one, other)


def _larger(one: Any, other: Any) -> Any:
    return -_smaller(-one, -other)


FUNCTIONS: dict[str, Callable[..., Any]] = {
    '+': operator.add,
    '-': operator.sub,
    '*': operator.mul,
    '/': operator.truediv,
    'abs': abs,
    'min': _smaller,
    'max': _larger,
}
"""Functions of values, and operations."""
