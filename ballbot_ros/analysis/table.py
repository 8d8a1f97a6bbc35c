"""The numbers of a figure as a table, which both the picture and the CSV file use."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

MAX_FIGURE_ROWS = 20_000
"""Maximum number of rows (80 s of ticks) that a figure shows one by one."""

_ROWS_PER_INTERVAL = 4
"""Minimum number of rows that become the two of an interval."""

Table = Mapping[str, NDArray[Any]]
"""Columns of equal length by name; the first one is the time [s]."""


def plane_columns(name: str, unit: str, values: NDArray[Any]) -> dict[str, NDArray[Any]]:
    """Return the columns for values of both planes, shape (n, 2), by name."""
    return {f'{name}_x_{unit}': values[:, 0], f'{name}_y_{unit}': values[:, 1]}


def track_columns(position: NDArray[Any]) -> dict[str, NDArray[Any]]:
    """Return the track in ``map`` [cm] for positions in the planes [m], (n, 2)."""
    x, y = position.T * 100.0
    return {'map_x_cm': x, 'map_y_cm': -y}


def envelope(
    time: NDArray[Any], columns: Mapping[str, NDArray[Any]], max_rows: int = MAX_FIGURE_ROWS
) -> Table:
    """Return a table of the columns; more than `max_rows` are reduced to extremes of intervals.

    Each interval then has two rows, with the minimum and the maximum of each column. A line through
    them covers the same area as a line through all rows.
    """
    if len(time) <= max_rows:
        return {'time_s': time, **columns}
    intervals = max_rows // _ROWS_PER_INTERVAL
    bounds = np.linspace(0, len(time), intervals + 1).astype(int)[:-1]
    table = {'time_s': np.repeat(time[bounds], 2)}
    table['time_s'][1::2] += np.diff(time[bounds], append=time[-1]) / 2.0
    for name, values in columns.items():
        table[name] = np.empty(2 * intervals)
        table[name][0::2] = np.fmin.reduceat(values, bounds)
        table[name][1::2] = np.fmax.reduceat(values, bounds)
    return table


def every_nth(time: NDArray[Any], columns: Mapping[str, NDArray[Any]]) -> Table:
    """Return a table of the columns; many rows are reduced to every nth and the last."""
    stride = -(-len(time) // MAX_FIGURE_ROWS)
    rows = np.unique(np.append(np.arange(0, len(time), stride), len(time) - 1))
    return {'time_s': time[rows], **{name: values[rows] for name, values in columns.items()}}


def csv_of(table: Table) -> bytes:
    """Return a table as CSV; a missing number is an empty field."""
    rows = zip(*(values.tolist() for values in table.values()), strict=True)
    return csv_text(list(table), ([_text(value) for value in row] for row in rows))


def csv_text(header: Sequence[str], rows: Iterable[Sequence[str]]) -> bytes:
    """Return a header and rows as CSV."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator='\n')
    writer.writerow(header)
    writer.writerows(rows)
    return text.getvalue().encode()


def _text(value: float | str) -> str:
    if isinstance(value, str):
        return value
    return '' if value != value else f'{value:.9g}'
