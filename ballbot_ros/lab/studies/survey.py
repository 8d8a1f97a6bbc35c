"""What a report counts in the rows of a study, part by part.

A study may have more rows than fit into memory. They are read twice: once for the range of each
column and for a random sample, once for the counts in cells.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ballbot_ros.lab.studies.axes import Axis, Extent
from ballbot_ros.lab.studies.columns import PASSED, ColumnKind, ResultColumn
from ballbot_ros.lab.studies.manifest import PartSummary
from ballbot_ros.lab.studies.study_data import StudyData

Floats = NDArray[np.float64]
Counts = NDArray[np.int64]


@dataclass(frozen=True)
class Survey:
    """Ranges of the columns, and a sample of the rows.

    Attributes
    ----------
    totals : PartSummary
        Numbers of runs.
    extents : mapping of str to Extent
        Of what varies and what is measured.
    sample : mapping of str to ndarray
        The same columns, and ``passed``, of some runs.
    """

    totals: PartSummary
    extents: Mapping[str, Extent]
    sample: Mapping[str, NDArray[Any]]

    @classmethod
    def of(cls, data: StudyData, size: int, random: np.random.Generator) -> Survey:
        """Survey a study.

        Parameters
        ----------
        size : int
            Largest number of runs in the sample, which are drawn at random.
        """
        totals = data.totals()
        chosen = np.arange(totals.runs)
        if totals.runs > size:
            chosen = np.sort(random.choice(totals.runs, size, replace=False, shuffle=False))
        columns = [*data.study.varied, *data.study.measures]
        extents = {each.name: Extent() for each in columns}
        found: dict[str, list[NDArray[Any]]] = {each.name: [] for each in (*columns, PASSED)}
        done = 0
        for table in data.parts(list(found)):
            first, end = np.searchsorted(chosen, [done, done + table.num_rows])
            places = chosen[first:end] - done
            for each in columns:
                values = column_values(table, each)
                extents[each.name].add(values)
                found[each.name].append(values[places])
            found[PASSED.name].append(column_values(table, PASSED)[places])
            done += table.num_rows
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
    columns = {each.column.name: each.column for each in used}
    for table in data.parts([*columns, *edges, PASSED.name]):
        passed = column_values(table, PASSED)
        values = {name: column_values(table, each) for name, each in columns.items()}
        for (x, y), counts in zip(pairs, maps, strict=True):
            places = y.places(values[y.column.name]) * x.cells
            _count(counts, places + x.places(values[x.column.name]), passed)
        for axis, counts in zip(axes, shares, strict=True):
            _count(counts, axis.places(values[axis.column.name]), passed)
        for (name, limits), counts in zip(edges.items(), histograms, strict=True):
            measured = column_values(table, ResultColumn(name))
            known = ~np.isnan(measured)
            _count(counts, _bins(limits, measured[known]), passed[known])
    shaped = [
        CellCounts(each.runs.reshape(y.cells, -1), each.passed.reshape(y.cells, -1))
        for each, (_, y) in zip(maps, pairs, strict=True)
    ]
    return Tallies(shaped, shares, histograms)


def column_values(table: Any, column: ResultColumn) -> NDArray[Any]:
    """Return a column of a part: numbers, NaN where there is none, or words, also for switches."""
    found = table.column(column.name)
    if column.kind is ColumnKind.TEXT:
        return np.asarray(found.cast('string').to_numpy()).astype(str)
    values = np.asarray(found.to_numpy())
    if column.kind is ColumnKind.BOOLEAN and column is not PASSED:
        return np.where(values, 'true', 'false')
    return values


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
