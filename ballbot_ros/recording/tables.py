"""Tables on disk: CSV, and Parquet if pyarrow is installed."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ballbot_ros.recording.columns import Value
from ballbot_ros.recording.errors import RecordingError

CELLS_AT_ONCE = 2**21
"""Size of the row groups of all tables; each character of a text counts as a cell."""


class CsvTable:
    """A CSV file with a header line; numbers have the shortest form that reads back exactly."""

    def __init__(self, path: Path, columns: Sequence[tuple[str, type]], tables: int = 1) -> None:
        self._file = path.open('x', newline='', encoding='utf-8')
        self._writer = csv.writer(self._file)
        self._writer.writerow([name for name, _ in columns])

    def add(self, row: Sequence[Value | None]) -> None:
        """Add a row; None becomes an empty cell."""
        self._writer.writerow(row)

    def close(self) -> None:
        """Finish the file."""
        self._file.close()


class ParquetTable:
    """A Parquet file, written in row groups: one of several `tables` that are open."""

    def __init__(self, path: Path, columns: Sequence[tuple[str, type]], tables: int = 1) -> None:
        self._arrow = load_pyarrow()
        types = {
            float: self._arrow.float64(),
            int: self._arrow.int64(),
            bool: self._arrow.bool_(),
            str: self._arrow.string(),
        }
        self._schema = self._arrow.schema([(name, types[kind]) for name, kind in columns])
        self._path = path
        self._texts = [number for number, (_, kind) in enumerate(columns) if kind is str]
        self._rows: list[Sequence[Value | None]] = []
        self._cells, self._most_cells = 0, CELLS_AT_ONCE // tables
        self._file = path.open('xb')
        self._writer = self._arrow.parquet.ParquetWriter(self._file, self._schema)

    def add(self, row: Sequence[Value | None]) -> None:
        """Add a row; None becomes null."""
        self._rows.append(row)
        self._cells += len(row) + sum(len(str(row[number])) for number in self._texts)
        if self._cells >= self._most_cells:
            self._write()

    def close(self) -> None:
        """Finish the file."""
        self._write()
        self._writer.close()
        self._file.close()

    def _write(self) -> None:
        columns = zip(*self._rows, strict=True) if self._rows else ([] for _ in self._schema)
        try:
            arrays = [
                self._arrow.array(column, type=each.type)
                for column, each in zip(columns, self._schema, strict=True)
            ]
        except (OverflowError, ValueError) as error:  # for example, an integer beyond 63 bits
            raise RecordingError(f'{self._path}: {" ".join(str(error).split())}') from None
        self._writer.write_table(self._arrow.Table.from_arrays(arrays, schema=self._schema))
        self._rows.clear()
        self._cells = 0


def load_pyarrow() -> Any:
    """Return pyarrow.

    Raises
    ------
    RecordingError
        If it is not installed.
    """
    try:
        import pyarrow
        import pyarrow.parquet
    except ImportError:
        raise RecordingError(
            'pyarrow not found: install it with `pip install "ballbot_ros[parquet]"`, '
            'or use --to csv'
        ) from None
    return pyarrow


Table = CsvTable | ParquetTable
FORMATS: dict[str, type[Table]] = {'csv': CsvTable, 'parquet': ParquetTable}
