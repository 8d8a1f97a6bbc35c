"""Messages as rows of a table: one column per number, with its SI unit in the name.

The values are read from a message, or from many at once: from a record array, in which
:meth:`~ballbot_ros.recording.reader.RecordingReader.records` returns them.
"""

from __future__ import annotations

import csv
import json
import math
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from rosbags.interfaces import Nodetype
from rosbags.typesys.store import Typestore

from ballbot_ros.errors import RecordingError, importing

Value = bool | int | float | str
Get = Callable[[Any], Any]
Read = Callable[[Any], Any]
"""Returns the value of a message, or the values of a record array as an array."""

FieldPath = tuple[str, ...]
Leaf = tuple[FieldPath, str, Read]
"""FieldPath of field names to a value, its unit, and the function that reads it from a message."""

_UNITS: dict[str, dict[str, str]] = {
    'geometry_msgs/msg/Pose': {'position': 'm'},
    'geometry_msgs/msg/PointStamped': {'point': 'm'},
    'geometry_msgs/msg/Transform': {'translation': 'm'},
    'geometry_msgs/msg/Twist': {'linear': 'm_per_s', 'angular': 'rad_per_s'},
    'geometry_msgs/msg/Accel': {'linear': 'm_per_s2', 'angular': 'rad_per_s2'},
    'geometry_msgs/msg/Wrench': {'force': 'N', 'torque': 'N_m'},
    'sensor_msgs/msg/Imu': {'angular_velocity': 'rad_per_s', 'linear_acceleration': 'm_per_s2'},
    'sensor_msgs/msg/Range': {
        'field_of_view': 'rad', 'min_range': 'm', 'max_range': 'm', 'range': 'm', 'variance': 'm2',
    },
    'sensor_msgs/msg/BatteryState': {
        'voltage': 'V', 'temperature': 'degC', 'current': 'A', 'charge': 'Ah', 'capacity': 'Ah',
        'design_capacity': 'Ah',
    },
    'sensor_msgs/msg/MagneticField': {'magnetic_field': 'T'},
    'sensor_msgs/msg/Temperature': {'temperature': 'degC'},
    'sensor_msgs/msg/FluidPressure': {'fluid_pressure': 'Pa'},
    'sensor_msgs/msg/Illuminance': {'illuminance': 'lx'},
    'sensor_msgs/msg/NavSatFix': {'latitude': 'deg', 'longitude': 'deg', 'altitude': 'm'},
}  # fmt: skip
"""Units that the definition of a type gives to a field, or to all numbers in it."""

_JOINT_STATE = 'sensor_msgs/msg/JointState'
_LISTS: dict[str, dict[str, str]] = {
    _JOINT_STATE: {'position': 'rad', 'velocity': 'rad_per_s', 'effort': 'N_m'},
    'sensor_msgs/msg/Joy': {'axes': '', 'buttons': ''},
}
"""Lists with a column for each element, and its unit, by type."""

_TIMES = ('builtin_interfaces/msg/Time', 'builtin_interfaces/msg/Duration')
_HEADER = 'std_msgs/msg/Header'

OWN_STAMP = 'stamp_s'
"""Column with the stamp of a message's header."""

_CONTAINERS = {'header', 'pose', 'twist', 'accel', 'wrench', 'transform', 'vector', 'quaternion'}
"""Field names that add nothing to the names of their parts."""


class Column(NamedTuple):
    """A column's name, the Python type of its values, and the function that reads them."""

    name: str
    kind: type
    read: Read


class ComputedColumn(NamedTuple):
    """A column that is computed from others.

    Attributes
    ----------
    sources : tuple of str
        The other columns by field path and unit, such as ``orientation_w``. If a message lacks one
        of them, the value is NaN.
    compute : callable
        Returns the value for those of the sources, numbers or arrays of float64.
    """

    sources: tuple[str, ...]
    compute: Callable[..., Any]


@dataclass(frozen=True)
class ColumnHints:
    """Knowledge about a topic beyond its type.

    Attributes
    ----------
    names : mapping of str to str
        Column names by field path, such as ``vector_x``.
    extra : mapping of str to ComputedColumn
        Additional columns by name.
    rows : callable or None
        Returns the rows of a message that has several, each as a message; ValueError if it is
        malformed. A joined table leaves the topic out.
    """

    names: Mapping[str, str] = field(default_factory=dict)
    extra: Mapping[str, ComputedColumn] = field(default_factory=dict)
    rows: Callable[[Any], Iterable[Any]] | None = None


@dataclass
class TopicColumns:
    """The columns of a topic, determined by its first message; the caller may select some."""

    first: Any
    hints: ColumnHints

    def __post_init__(self) -> None:
        self._shape = _shape(self.first)
        found = [
            (_name(path, unit), _name([w for w in path if w not in _CONTAINERS], unit), read)
            for path, unit, read in _leaves(self.first, (), '', lambda message: message)
        ]
        times = Counter(short for _, short, _ in found)
        self.columns = [
            Column(
                self.hints.names.get(full) or (short if times[short] == 1 else full),
                type(read(self.first)),
                read,
            )
            for full, short, read in found
        ]
        reads = {full: read for full, _, read in found}
        self.columns += [
            Column(name, float, _computed(computed, reads))
            for name, computed in self.hints.extra.items()
        ]

    @property
    def has_header(self) -> bool:
        """Whether the messages have a header, which stamps them."""
        return _type_name(getattr(self.first, 'header', None)) == _HEADER

    def fits(self, message: object) -> bool:
        """Return whether the columns mean the same in a message as in the first one."""
        return bool(_shape(message) == self._shape)

    def row(self, message: object) -> list[Value]:
        """Return the values of a message.

        It raises RecordingError if its joints, or its numbers of axes and buttons, differ from the
        first message.
        """
        if not self.fits(message):
            raise RecordingError(
                'the names or the number of its elements differ from the first message'
            )
        return [column.read(message) for column in self.columns]


def has_signals(type_name: str, store: Typestore) -> bool:
    """Return whether messages of a type in `store` can have columns that are signals."""
    if type_name in (_HEADER, *_LISTS, *_TIMES):
        return type_name != _HEADER
    _, fields_of_type = store.fielddefs[type_name]
    return any(
        has_signals(str(detail), store)
        if node == Nodetype.NAME
        else node == Nodetype.BASE and detail[0] != 'string'  # lists are text
        for _, (node, detail) in fields_of_type
    )


def _computed(column: ComputedColumn, reads: Mapping[str, Read]) -> Read:
    """Return the function that reads a computed column; `reads` has those of the fields."""
    if not reads.keys() >= set(column.sources):
        return lambda message: math.nan
    sources = [reads[source] for source in column.sources]
    return lambda message: _plain(column.compute(*(np.float64(each(message)) for each in sources)))


def _shape(message: object) -> object:
    """Return the part of a message that must not change, or columns would change their meaning."""
    lists = _LISTS.get(_type_name(message), ())
    return _names(message), *(len(getattr(message, name)) for name in lists)


def _leaves(value: Any, path: FieldPath, unit: str, get: Get) -> list[Leaf]:
    """Return all parts of `value` that become columns; `get` finds `value` in a message."""
    type_name = _type_name(value)
    if type_name in _TIMES:
        return [(path, 's', lambda message: _seconds(get(message)))]
    if type_name in _LISTS:
        leaves = _leaves(value.header, (*path, 'header'), '', _field(get, 'header'))
        for group, element_unit in _LISTS[type_name].items():
            count, names = len(getattr(value, group)), _names(value)
            names = names if len(names) == count else list(map(str, range(count)))
            leaves += _elements(names, (*path, group), element_unit, _field(get, group))
        return leaves
    if type_name:
        leaves = []
        for name in _fields(value):
            inner = _UNITS.get(type_name, {}).get(name, unit)
            leaves += _leaves(getattr(value, name), (*path, name), inner, _field(get, name))
        return leaves
    if isinstance(value, list | np.ndarray):
        return [(path, '', lambda message: _text(get(message)))]
    return [(path, unit, lambda message: _plain(get(message)))]


def _names(message: Any) -> list[str]:
    """Return the names of the joints in a message."""
    return list(message.name) if _type_name(message) == _JOINT_STATE else []


def _field(get: Get, name: str) -> Get:
    return lambda message: _part(get(message), name)


def _part(value: object, name: str) -> Any:
    # A field of a record array may have the name of an attribute of arrays, such as `data`.
    return value[name] if isinstance(value, np.ndarray) else getattr(value, name)


def _elements(names: Iterable[str], path: FieldPath, unit: str, get: Get) -> list[Leaf]:
    def element(number: int) -> Read:
        return lambda message: _plain(get(message).T[number])

    return [((*path, name), unit, element(number)) for number, name in enumerate(names)]


def _name(path: Iterable[str], unit: str) -> str:
    return '_'.join([*path, unit] if unit else path)


def _type_name(value: object) -> str:
    return str(getattr(value, '__msgtype__', ''))


def _fields(value: Any) -> list[str]:
    # rosbags declares constants of a type as fields, too, with a value in the class.
    return [each.name for each in fields(value) if each.name not in vars(type(value))]


def _seconds(time: object) -> object:
    return _plain((np.int64(_part(time, 'sec')) * 10**9 + _part(time, 'nanosec')) / 1e9)


def _plain(value: object) -> object:
    """Return numbers of numpy as those of Python, and anything else as it is."""
    return value.item() if isinstance(value, np.generic) else value


def _text(value: object) -> str:
    """Write a list as JSON, bytes as two hexadecimal digits each."""
    if isinstance(value, np.ndarray) and value.dtype == np.uint8:
        return value.tobytes().hex()
    if isinstance(value, np.ndarray):
        parts = (value[at : at + 4096] for at in range(0, len(value), 4096))  # a map has 16 MB
        return f'[{", ".join(json.dumps(part.tolist())[1:-1] for part in parts)}]'
    return json.dumps(_nested(value), ensure_ascii=False)


def _nested(value: object) -> object:
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, list):
        return [_nested(item) for item in value]
    if _type_name(value):
        return {name: _nested(getattr(value, name)) for name in _fields(value)}
    return _plain(value)


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
    """Return pyarrow; MissingExtraError if it is not installed."""
    with importing('parquet', ', or use --to csv'):
        import pyarrow
        import pyarrow.parquet
    return pyarrow


Table = CsvTable | ParquetTable
FORMATS: dict[str, type[Table]] = {'csv': CsvTable, 'parquet': ParquetTable}
