"""Distributions of what varies in a study: from uniform numbers to values."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

MAX_LEVELS = 100_000
"""Largest number of values of one variable in a grid."""


class Distribution(Protocol):
    """A distribution, by its quantile function."""

    @property
    def ends(self) -> tuple[Any, Any]:
        """The smallest and the largest value."""

    def values(self, shares: Floats) -> NDArray[Any]:
        """Return the values below which these shares, within [0, 1), of all values lie."""


class _Limited:
    """What lies between two values."""

    low: Any
    high: Any

    @property
    def ends(self) -> tuple[Any, Any]:
        """The smallest and the largest value."""
        return self.low, self.high


@dataclass(frozen=True)
class Uniform(_Limited):
    """Any number from `low` to `high`, with equal chances."""

    low: float
    high: float

    def values(self, shares: Floats) -> Floats:
        """Return the values for shares within [0, 1)."""
        return np.clip(self.low + shares * (self.high - self.low), self.low, self.high)


@dataclass(frozen=True)
class LogUniform(_Limited):
    """Numbers from `low` to `high`, both positive, whose logarithms have equal chances."""

    low: float
    high: float

    def values(self, shares: Floats) -> Floats:
        """Return the values for shares within [0, 1)."""
        low, high = math.log(self.low), math.log(self.high)
        return np.clip(np.exp(low + shares * (high - low)), self.low, self.high)


@dataclass(frozen=True)
class Normal(_Limited):
    """A normal distribution of which only the part from `low` to `high` remains."""

    mean: float
    standard_deviation: float
    low: float
    high: float

    def values(self, shares: Floats) -> Floats:
        """Return the values for shares within [0, 1)."""
        from scipy.special import ndtr, ndtri

        below, above = ndtr([self._scaled(self.low), -self._scaled(self.high)])
        lower = below + shares * (1.0 - below - above)
        # Near 1 a share has few digits left, so take the distance from 1 instead.
        upper = above + (1.0 - shares) * (1.0 - below - above)
        scaled = np.where(lower < 0.5, ndtri(lower), -ndtri(upper))
        values: Floats = np.clip(self.mean + self.standard_deviation * scaled, self.low, self.high)
        return values

    def _scaled(self, value: float) -> float:
        return (value - self.mean) / self.standard_deviation


@dataclass(frozen=True)
class WholeNumbers(_Limited):
    """The values of another distribution, rounded to whole numbers from `low` to `high`.

    That of ``whole_numbers`` reaches half a number farther, so that the ends are not rarer.
    """

    rounded: Uniform | LogUniform | Normal
    low: int
    high: int

    def values(self, shares: Floats) -> NDArray[np.int64]:
        """Return the values for shares within [0, 1)."""
        # Above 2^53 a float is no exact whole number; the largest float below 2^63 fits.
        rounded = np.minimum(np.rint(self.rounded.values(shares)), np.nextafter(2.0**63, 0.0))
        return np.clip(rounded.astype(np.int64), self.low, self.high)


def whole_numbers(given: Uniform | LogUniform | Normal) -> WholeNumbers:
    """Return the whole numbers of a distribution whose ends are whole numbers."""
    low, high = int(given.low), int(given.high)
    wider: Uniform | LogUniform | Normal
    if isinstance(given, Normal):
        wider = Normal(given.mean, given.standard_deviation, low - 0.5, high + 0.5)
    else:
        wider = type(given)(low - 0.5, high + 0.5)
    return WholeNumbers(wider, low, high)


@dataclass(frozen=True)
class Levels:
    """A few values, with equal chances.

    Attributes
    ----------
    levels : tuple
        Numbers, switches or words.
    """

    levels: tuple[Any, ...]

    @property
    def ends(self) -> tuple[Any, Any]:
        """The smallest and the largest value."""
        return min(self.levels), max(self.levels)

    def values(self, shares: Floats) -> NDArray[Any]:
        """Return the values for shares within [0, 1)."""
        numbers = np.floor(shares * len(self.levels)).astype(np.int64)
        return self.at(np.minimum(numbers, len(self.levels) - 1))

    def at(self, numbers: NDArray[np.int64]) -> NDArray[Any]:
        """Return the values with these numbers, from 0."""
        return np.array(self.levels)[numbers]


class Grid(Levels):
    """Real numbers at equal distances, of which there may be more or fewer."""

    def with_count(self, count: int) -> Grid:
        """Return so many numbers with the same ends."""
        return Grid(tuple(np.linspace(*self.ends, min(max(2, count), MAX_LEVELS)).tolist()))
