"""What a figure shows, as a table: the same numbers go to the picture and to the CSV file."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

MANY = 20_000
"""Rows (80 s of ticks) up to which a figure shows every one."""

_INTERVALS = 5_000

Table = Mapping[str, NDArray[Any]]
"""Columns of equal length by name; the first is the time [s]."""


def plane_columns(name: str, unit: str, values: NDArray[Any]) -> dict[str, NDArray[Any]]:
    """Return the columns of values of both planes, shape (n, 2), by their names."""
    return {f'{name}_x_{unit}': values[:, 0], f'{name}_y_{unit}': values[:, 1]}


def track_columns(position: NDArray[Any]) -> dict[str, NDArray[Any]]:
    """Return the columns of a track in ``map`` [cm], of positions in the planes [m], (n, 2)."""
    x, y = position.T * 100.0
    return {'map_x_cm': x, 'map_y_cm': -y}


def envelope(time: NDArray[Any], columns: Mapping[str, NDArray[Any]]) -> Table:
    """Return a table of the columns, of many rows the least and the largest of each interval.

    Every interval then has two rows: the first has the least value of each column in it, the
    second the largest. A line through them fills what a line through all would fill.
    """
    if len(time) <= MANY:
        return {'time_s': time, **columns}
    bounds = np.linspace(0, len(time), _INTERVALS + 1).astype(int)[:-1]
    table = {'time_s': np.repeat(time[bounds], 2)}
    table['time_s'][1::2] += np.diff(time[bounds], append=time[-1]) / 2.0
    for name, values in columns.items():
        table[name] = np.empty(2 * _INTERVALS)
        table[name][0::2] = np.fmin.reduceat(values, bounds)
        table[name][1::2] = np.fmax.reduceat(values, bounds)
    return table


def every_nth(time: NDArray[Any], columns: Mapping[str, NDArray[Any]]) -> Table:
    """Return a table of the columns, of many rows every nth and the last, for a way."""
    stride = -(-len(time) // MANY)
    rows = np.unique(np.append(np.arange(0, len(time), stride), len(time) - 1))
    return {'time_s': time[rows], **{name: values[rows] for name, values in columns.items()}}


def csv_of(table: Table) -> bytes:
    """Return a table as CSV; a number that is not there is an empty field."""
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
