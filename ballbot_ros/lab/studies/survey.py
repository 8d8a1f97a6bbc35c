"""What a report counts in the rows of a study, part by part, and the axes of its maps.

A study may have more rows than fit into memory. They are read twice: once for the range of each
column and for a random sample, once for the counts in cells.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ballbot_ros.engine.rows import Column
from ballbot_ros.lab.studies.columns import PASSED, ColumnKind, ResultColumn
from ballbot_ros.lab.studies.manifest import PartSummary
from ballbot_ros.lab.studies.study_data import StudyData
from ballbot_ros.robot.arithmetic import Floats

MAX_LEVELS = 300
"""Largest number of different numbers that are shown one by one; words always are."""


class Extent:
    """The values of a column that have been seen so far.

    Attributes
    ----------
    low, high : float
        The smallest and the largest number; without any, low is larger.
    levels : ndarray or None
        The different values, sorted; None for more than :data:`MAX_LEVELS` numbers.
    """

    def __init__(self) -> None:
        self.low, self.high = math.inf, -math.inf
        self.levels: Column | None = None
        self._seen = False

    def add(self, values: Column) -> None:
        """Take more values, of which NaN and infinite ones do not count."""
        if values.dtype.kind == 'f':
            values = values[np.isfinite(values)]
        if not len(values):
            return
        is_words = values.dtype.kind == 'U'
        if not is_words:
            self.low = min(self.low, float(values.min()))
            self.high = max(self.high, float(values.max()))
        if self._seen and self.levels is None:
            return
        parts = [values] if self.levels is None else [self.levels, values]
        levels = np.unique(np.concatenate(parts))
        self.levels = levels if is_words or len(levels) <= MAX_LEVELS else None
        self._seen = True


@dataclass(frozen=True)
class Axis:
    """The values of a variable, in cells.

    Attributes
    ----------
    edges : ndarray, shape (n + 1,)
        Edges of the cells; those of words have a width of 1 and middles 0, 1, ….
    levels : ndarray of shape (n,), or None
        The value in each cell, if a cell has only one.
    """

    column: ResultColumn
    edges: Floats
    levels: Column | None = None
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
        """Return an axis for all values that have been seen in so many runs.

        `bins` is the largest number of bins, and of levels if the study is no grid.
        """
        levels = extent.levels
        if levels is not None and levels.dtype.kind == 'U':
            return cls(column, np.arange(-0.5, len(levels)), levels)
        repeated = levels is not None and (
            is_grid or column.kind is ColumnKind.INTEGER or 2 * len(levels) <= runs
        )
        if levels is not None and repeated and len(levels) <= (MAX_LEVELS if is_grid else bins):
            return cls(column, edges_between(levels.astype(float), is_log), levels, is_log)
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
    def shown(self) -> Column:
        """The words, or the middles, shape (n,)."""
        return self.levels if self.is_words and self.levels is not None else self.middles

    @property
    def span(self) -> Column:
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

    def places(self, values: Column) -> NDArray[np.intp]:
        """Return the cells of values, shape (r,)."""
        if self.levels is not None:
            return np.searchsorted(self.levels, values)
        found = np.searchsorted(self.edges, values, side='right') - 1
        return np.clip(found, 0, self.cells - 1)


def with_unit(name: str, unit: str) -> str:
    """Return a name, followed by its unit if it has one."""
    return f'{name} [{unit}]' if unit not in ('', '1') else name


def edges_between(levels: Floats, is_log: bool = False) -> Floats:
    """Return edges in the middle between levels."""
    scale = np.log(levels) if is_log else levels
    if len(levels) == 1:
        edges: Floats = np.array([scale[0] - 0.5, scale[0] + 0.5])
    else:
        middles = (scale[1:] + scale[:-1]) / 2.0
        edges = np.concatenate([
            [2.0 * scale[0] - middles[0]], middles, [2.0 * scale[-1] - middles[-1]]
        ])  # fmt: skip
    return np.exp(edges) if is_log else edges


Counts = NDArray[np.int64]


@dataclass(frozen=True)
class Survey:
    """Ranges of what varies and what is measured, and a sample of the same and ``passed``."""

    totals: PartSummary
    extents: Mapping[str, Extent]
    sample: Mapping[str, Column]

    @classmethod
    def of(cls, data: StudyData, size: int, random: np.random.Generator) -> Survey:
        """Survey a study; `size` is the largest number of runs in the sample, drawn at random."""
        totals = data.totals()
        chosen = np.arange(totals.runs)
        if totals.runs > size:
            chosen = np.sort(random.choice(totals.runs, size, replace=False, shuffle=False))
        columns = [*data.study.varied, *data.study.measures]
        extents = {each.name: Extent() for each in columns}
        found: dict[str, list[Column]] = {each.name: [] for each in (*columns, PASSED)}
        done = 0
        for part in data.parts(list(found)):
            runs = len(part[PASSED.name])
            first, end = np.searchsorted(chosen, [done, done + runs])
            places = chosen[first:end] - done
            for name, extent in extents.items():
                part[name] = _words_of_switches(part[name])
                extent.add(part[name])
            for name, values in part.items():
                found[name].append(values[places])
            done += runs
        sample = {name: np.concatenate(parts) for name, parts in found.items() if parts}
        return cls(totals, extents, sample)


@dataclass(frozen=True)
class CellCounts:
    """Runs in the cells of a map or of an axis, and how many of them passed."""

    runs: Counts
    passed: Counts

    @property
    def share(self) -> Floats:
        """Share that passed; NaN where there are no runs."""
        with np.errstate(invalid='ignore'):
            share: Floats = self.passed / self.runs
        return share


@dataclass(frozen=True)
class Tallies:
    """Counts of a study.

    Attributes
    ----------
    maps : list of CellCounts
        Of each pair, shape (cells of the second axis, cells of the first).
    shares : list of CellCounts
        Of each axis, shape (cells,).
    histograms : list of CellCounts
        Of each measure, shape (bins + 2,): the first and the last count what is beyond the edges.
    """

    maps: list[CellCounts]
    shares: list[CellCounts]
    histograms: list[CellCounts]


def tally(
    data: StudyData,
    pairs: Sequence[tuple[Axis, Axis]],
    axes: Sequence[Axis],
    edges: Mapping[str, Floats],
) -> Tallies:
    """Count the runs of a study in cells.

    Parameters
    ----------
    pairs : sequence of tuple of Axis
        Of each map: the horizontal and the vertical axis.
    axes : sequence of Axis
        For the share that passed over a single variable.
    edges : mapping of str to ndarray
        Edges of the histogram of each measure.
    """
    maps = [_empty(y.cells * x.cells) for x, y in pairs]
    shares = [_empty(each.cells) for each in axes]
    histograms = [_empty(len(each) + 1) for each in edges.values()]
    used = [*axes, *(axis for pair in pairs for axis in pair)]
    columns = dict.fromkeys(each.column.name for each in used)
    for part in data.parts([*columns, *edges, PASSED.name]):
        passed = part[PASSED.name]
        values = {name: _words_of_switches(part[name]) for name in columns}
        for (x, y), counts in zip(pairs, maps, strict=True):
            places = y.places(values[y.column.name]) * x.cells
            _count(counts, places + x.places(values[x.column.name]), passed)
        for axis, counts in zip(axes, shares, strict=True):
            _count(counts, axis.places(values[axis.column.name]), passed)
        for (name, limits), counts in zip(edges.items(), histograms, strict=True):
            known = ~np.isnan(part[name])
            _count(counts, _bins(limits, part[name][known]), passed[known])
    shaped = [
        CellCounts(each.runs.reshape(y.cells, -1), each.passed.reshape(y.cells, -1))
        for each, (_, y) in zip(maps, pairs, strict=True)
    ]
    return Tallies(shaped, shares, histograms)


def _words_of_switches(values: Column) -> Column:
    return np.where(values, 'true', 'false') if values.dtype.kind == 'b' else values


def _empty(cells: int) -> CellCounts:
    return CellCounts(np.zeros(cells, np.int64), np.zeros(cells, np.int64))


def _count(counts: CellCounts, places: NDArray[np.intp], passed: NDArray[np.bool_]) -> None:
    cells = len(counts.runs)
    counts.runs[:] += np.bincount(places, minlength=cells)
    counts.passed[:] += np.bincount(places[passed], minlength=cells)


def _bins(edges: Floats, values: Floats) -> NDArray[np.intp]:
    """Return the bins of values; 0 is below the edges, the last one above; the top edge is in."""
    found = np.searchsorted(edges, values, side='right')
    return np.where(values == edges[-1], len(edges) - 1, found)
