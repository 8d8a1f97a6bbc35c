"""Axes of maps: the values of a variable as levels or bins."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ballbot_ros.lab.studies.columns import ColumnKind, ResultColumn

Floats = NDArray[np.float64]

MAX_LEVELS = 300
"""Largest number of different values that are shown one by one."""


class Extent:
    """The values of a column that have been seen so far.

    Attributes
    ----------
    low, high : float
        The smallest and the largest number; without any, low is larger.
    levels : ndarray or None
        The different values, sorted; None if there are more than :data:`MAX_LEVELS`.
    """

    def __init__(self) -> None:
        self.low, self.high = math.inf, -math.inf
        self.levels: NDArray[Any] | None = None
        self._seen = False

    def add(self, values: NDArray[Any]) -> None:
        """Take more values, of which NaN and infinite ones do not count."""
        if values.dtype.kind == 'f':
            values = values[np.isfinite(values)]
        if not len(values):
            return
        if values.dtype.kind != 'U':
            self.low = min(self.low, float(values.min()))
            self.high = max(self.high, float(values.max()))
        if self._seen and self.levels is None:
            return
        parts = [values] if self.levels is None else [self.levels, values]
        levels = np.unique(np.concatenate(parts))
        self.levels = levels if len(levels) <= MAX_LEVELS else None
        self._seen = True


@dataclass(frozen=True)
class Axis:
    """The values of a variable, in cells.

    Attributes
    ----------
    column : Column
        The variable.
    edges : ndarray, shape (n + 1,)
        Edges of the cells; those of words have a width of 1 and middles 0, 1, ….
    levels : ndarray of shape (n,), or None
        The value in each cell, if a cell has only one.
    is_log : bool
        Whether it is logarithmic.
    """

    column: ResultColumn
    edges: Floats
    levels: NDArray[Any] | None = None
    is_log: bool = False

    @classmethod
    def of(
        cls,
        column: ResultColumn,
        extent: Extent,
        runs: int,
        bins: int,
        *,
        is_grid: bool = False,
        is_log: bool = False,
    ) -> Axis:
        """Return an axis for all values that have been seen.

        Parameters
        ----------
        runs : int
            Number of runs.
        bins : int
            Largest number of bins, and of levels if the study is no grid.
        """
        levels = extent.levels
        if levels is not None and levels.dtype.kind == 'U':
            return cls(column, np.arange(-0.5, len(levels)), levels)
        repeated = levels is not None and (
            is_grid or column.kind is ColumnKind.INTEGER or 2 * len(levels) <= runs
        )
        if levels is not None and repeated and len(levels) <= (MAX_LEVELS if is_grid else bins):
            return cls(column, _edges_between(levels.astype(float), is_log), levels, is_log)
        low, high = extent.low, extent.high
        if column.kind is ColumnKind.INTEGER:
            step = math.ceil((high - low + 1) / bins)
            return cls(column, np.arange(low - 0.5, high + 0.5 + step, step))
        if not low < high:
            return cls(column, np.array([low - 0.5, high + 0.5]))
        space = np.geomspace if is_log else np.linspace
        return cls(column, space(low, high, bins + 1), None, is_log)

    @property
    def cells(self) -> int:
        """Number of cells."""
        return len(self.edges) - 1

    @property
    def is_words(self) -> bool:
        """Whether the values are words or switches."""
        return self.levels is not None and self.levels.dtype.kind == 'U'

    @property
    def middles(self) -> Floats:
        """The level or the middle of each cell, shape (n,)."""
        if self.levels is not None and not self.is_words:
            return self.levels.astype(float)
        low, high = self.edges[:-1], self.edges[1:]
        return np.sqrt(low * high) if self.is_log else (low + high) / 2.0

    @property
    def shown(self) -> NDArray[Any]:
        """The words, or the middles, shape (n,)."""
        return self.levels if self.is_words and self.levels is not None else self.middles

    @property
    def span(self) -> NDArray[Any]:
        """Values that span a map: all levels of whole numbers, else both ends; words have none."""
        if self.levels is not None:
            return self.levels
        if self.column.kind is ColumnKind.INTEGER:
            low, high = self.edges[0] + 0.5, self.edges[-1] - 0.5
            return np.unique(np.linspace(low, high, 21).round().astype(int))
        return self.edges[[0, -1]]

    @property
    def is_stepped(self) -> bool:
        """Whether nothing lies between the levels, since they are whole numbers."""
        return self.levels is not None and self.column.kind is ColumnKind.INTEGER

    @property
    def label(self) -> str:
        """Name and unit."""
        return with_unit(self.column.name, self.column.unit)

    def places(self, values: NDArray[Any]) -> NDArray[np.intp]:
        """Return the cells of values, shape (r,)."""
        if self.levels is not None:
            return np.searchsorted(self.levels, values)
        found = np.searchsorted(self.edges, values, side='right') - 1
        return np.clip(found, 0, self.cells - 1)


def with_unit(name: str, unit: str) -> str:
    """Return a name, followed by its unit if it has one."""
    return f'{name} [{unit}]' if unit not in ('', '1') else name


def _edges_between(levels: Floats, is_log: bool) -> Floats:
    """Return edges in the middle between levels."""
    if len(levels) == 1:
        return np.array([levels[0] - 0.5, levels[0] + 0.5])
    scale = np.log(levels) if is_log else levels
    middles = (scale[1:] + scale[:-1]) / 2.0
    edges = np.concatenate([
        [2.0 * scale[0] - middles[0]], middles, [2.0 * scale[-1] - middles[-1]]
    ])  # fmt: skip
    return np.exp(edges) if is_log else edges
