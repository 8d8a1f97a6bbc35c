"""Columns of numbers, packed for a page: small, and read by a few lines of its script."""

from __future__ import annotations

import gzip
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

STEPS = 65_534
"""Steps into which the range of a column is divided; the next number stands for no number."""


class PackedColumn(NamedTuple):
    """Where a column is among the packed numbers: its first byte, and its number of values.

    Step 0 is `low`, and the last one `high`.
    """

    offset: int
    length: int
    low: float
    high: float


@dataclass
class PackedNumbers:
    """Columns of 16 bits a value, as differences; equal columns are kept once.

    The low bytes of a column come first, then the high ones: those of a smooth curve hardly differ,
    so that gzip makes them small.
    """

    def __init__(self) -> None:
        self._bytes = bytearray()
        self._known: dict[bytes, PackedColumn] = {}

    def add(self, values: NDArray[Any]) -> PackedColumn:
        """Add a column, shape (n,), and return where it is; NaN and infinity are no numbers."""
        column = np.asarray(values, float)
        key = column.tobytes()
        if key not in self._known:
            self._known[key] = self._append(column)
        return self._known[key]

    def _append(self, column: NDArray[np.float64]) -> PackedColumn:
        known = np.isfinite(column)
        low, high = _range(column[known])
        steps = np.full(len(column), STEPS + 1, np.uint16)
        steps[known] = np.rint((column[known] - low) / ((high - low) or 1.0) * STEPS)
        differences = np.diff(steps, prepend=np.uint16(0)).astype('<u2')
        packed = PackedColumn(len(self._bytes), len(column), low, high)
        self._bytes += (differences & 0xFF).astype(np.uint8).tobytes()
        self._bytes += (differences >> 8).astype(np.uint8).tobytes()
        return packed

    def compressed(self) -> bytes:
        """Return all columns, compressed with gzip; equal columns give equal bytes."""
        return gzip.compress(bytes(self._bytes), mtime=0)

    def values(self, column: PackedColumn) -> NDArray[np.float64]:
        """Return the numbers of a column as the page reads them."""
        offset, length, low, high = column
        data = np.frombuffer(bytes(self._bytes), np.uint8)[offset : offset + 2 * length]
        steps = np.cumsum(data[:length] + 256 * data[length:].astype(np.int64)) & 0xFFFF
        values = low + (high - low) * steps / STEPS
        return np.where(steps == STEPS + 1, np.nan, values)


def _range(values: NDArray[np.float64]) -> tuple[float, float]:
    return (float(values.min()), float(values.max())) if values.size else (0.0, 0.0)
