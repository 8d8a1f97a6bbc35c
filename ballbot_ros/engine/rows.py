"""Parameters and states of many robots as rows of tables, one table for each node."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from copy import copy
from dataclasses import Field, fields, is_dataclass, replace
from functools import cache
from typing import Any, Literal, NamedTuple, TypeVar, cast, get_args, get_origin, get_type_hints

import numpy as np
from numpy.typing import NDArray

from ballbot_ros.controllers.document.axis import ProgramConstants, Single
from ballbot_ros.engine.devices import choice
from ballbot_ros.parameters import (
    ALL_NODES,
    ROBOT_CLASSES,
    ControllerParameters,
    NodeParameters,
    Parameter,
    ParameterError,
    ParameterSet,
    parameters_of,
    suggest,
)

Rows = NDArray[np.void]
"""A structured array; its fields have the names of the parameters."""

Column = NDArray[Any]
"""A value of each of many runs: numbers, switches or words, shape (n,)."""

State = TypeVar('State', bound=tuple[Any, ...])
"""A named tuple of numbers."""

_NUMBERS: dict[Any, str] = {float: 'f8', int: 'i8', bool: '?', Single: 'f4', np.uint64: 'u8'}


class Record(NamedTuple):
    """The kind of a named tuple or a dataclass: its class, names and kinds of its members.

    The kind of a number is its type, that of a tuple a tuple of kinds.
    """

    cls: type
    names: tuple[str, ...]
    kinds: tuple[Any, ...]


def kind_of_class(cls: Any) -> Any:
    """Return the kind of the instances of a class, by its annotations."""
    if names := getattr(cls, '_fields', None) or [each.name for each in _fields(cls)]:
        hints = get_type_hints(cls)
        return Record(cls, tuple(names), tuple(kind_of_class(hints[each]) for each in names))
    if get_origin(cls) is tuple:
        return tuple(map(kind_of_class, get_args(cls)))
    return cls


def _fields(cls: object) -> Sequence[Field[object]]:
    return fields(cls) if is_dataclass(cls) else ()


def kind_of(value: Any) -> Any:
    """Return the kind of a number, a tuple or a named tuple."""
    if names := getattr(value, '_fields', ()):
        return Record(type(value), names, tuple(map(kind_of, value)))
    if isinstance(value, tuple):
        return tuple(map(kind_of, value))
    return next((each for each in (bool, int, float) if isinstance(value, each)), type(value))


@cache
def row_type(cls: type) -> np.dtype[np.void]:
    """Return the type of a row for a dataclass or a named tuple.

    It has numbers, switches, tuples and named tuples of them, and choices by their index; texts
    that are no choices are left out.
    """
    return row_type_of(kind_of_class(cls))


def row_type_of(kind: Record) -> np.dtype[np.void]:
    """Return the type of a row for a kind."""
    members = zip(kind.names, kind.kinds, strict=True)
    columns: Any = [(name, *column) for name, each in members if (column := _column(each))]
    row: np.dtype[np.void] = np.dtype(columns)
    return row


def _column(kind: object) -> tuple[object, ...]:
    """Return the type of a column, and the number of its elements; () if there is none."""
    if isinstance(kind, Record):
        return (row_type_of(kind),)
    if isinstance(kind, tuple):
        if _is_array(kind):
            return _NUMBERS[kind[0]], (len(kind),)
        inner = [(f'f{at}', *_column(each)) for at, each in enumerate(kind)]
        return (inner,) if inner and all(len(each) > 1 for each in inner) else ()
    if get_origin(kind) is Literal:
        return ('i8' if isinstance(get_args(kind)[0], int) else 'i1',)
    return (_NUMBERS[kind],) if kind in _NUMBERS else ()


def has_column(kind: object) -> bool:
    """Return whether a number of a kind has a place in a row."""
    return kind in _NUMBERS


def _is_array(kind: tuple[object, ...]) -> bool:
    return len(set(kind)) == 1 and kind[0] in _NUMBERS


def row_functions(cls: type[State]) -> tuple[Callable[[Any], State], Callable[[Any, State], None]]:
    """Return functions that read a named tuple from a row, and write it there."""
    return row_functions_of(kind_of_class(cls))


def row_functions_of(kind: Record) -> tuple[Callable[[Any], Any], Callable[[Any, Any], None]]:
    """Return functions that read a named tuple of a kind from a row, and write it there.

    They are made from its fields, as a dataclass makes its methods: the compiler takes neither a
    loop over fields nor one over a tuple of several types.
    """
    classes: dict[str, type] = {}
    numbers: list[tuple[str, str]] = []
    value = _add(kind, '', '', classes, numbers)
    copies = ''.join(f'    row{place} = state{part}\n' for place, part in numbers)
    source = f'def read(row):\n    return {value}\ndef write(row, state):\n{copies}'
    made: dict[str, Any] = {'__name__': __name__, **classes}
    exec(source, made)
    return made['read'], made['write']


def _add(
    kind: object, place: str, part: str, classes: dict[str, type], numbers: list[tuple[str, str]]
) -> str:
    """Add classes and numbers of a value, which is at a place of the row; return how it is read."""
    if isinstance(kind, Record):
        name = f'{kind.cls.__name__}_{len(classes)}'
        classes[name] = kind.cls
        members = zip(kind.names, kind.kinds, strict=True)
        parts = [
            _add(each, f'{place}.{member}', f'{part}.{member}', classes, numbers)
            for member, each in members
        ]
        return f'{name}({", ".join(parts)})'
    if isinstance(kind, tuple):
        form = '[{}]' if _is_array(kind) else '.f{}'
        parts = [
            _add(each, place + form.format(at), f'{part}[{at}]', classes, numbers)
            for at, each in enumerate(kind)
        ]
        return f'({"".join(f"{each}, " for each in parts)})'
    numbers.append((place, part))
    return f'row{place}'


def state_of(cls: Callable[..., State], row: np.void) -> State:
    """Return the state in a row, with the types that it has in the interpreter."""
    return cls(*map(_plain, row.item(), _are_single(row.dtype)))


@cache
def _are_single(row: np.dtype[np.void]) -> tuple[bool, ...]:
    """Return which columns of a row are in single precision."""
    return tuple(row[name].base == Single for name in row.names or ())


def _plain(value: Any, is_single: bool) -> object:
    """Return a number of a row, or the tuple of its numbers; those in single precision stay so."""
    if isinstance(value, np.ndarray):
        return tuple(value if is_single else value.tolist())
    return Single(value) if is_single else value


def columns_of(cls: Callable[..., State], rows: Rows) -> State:
    """Return a state whose numbers are columns: those of all rows."""
    columns = (rows[name] for name in rows.dtype.names or ())
    return cls(*(tuple(each.T) if each.ndim > 1 else each for each in columns))


def rows_of(values: Sequence[object]) -> Rows:
    """Return named tuples of one kind as rows."""
    kind = kind_of(values[0])
    rows = np.zeros(len(values), row_type_of(kind))
    for row, each in zip(rows, values, strict=True):
        put(row, each)
    return rows


def are_finite(rows: Rows) -> NDArray[np.bool_]:
    """Return for each row whether all its real numbers are finite."""
    finite = np.full(len(rows), True)
    for name in rows.dtype.names or ():
        finite &= are_finite(rows[name])
    if rows.dtype.kind == 'f':
        numbers: NDArray[np.float64] = rows.reshape(len(rows), -1)  # type: ignore[assignment]
        finite &= np.isfinite(numbers).all(axis=1)
    return finite


def put(row: np.void, value: Any) -> None:
    """Write a named tuple, or a tuple, into a row."""
    names = getattr(value, '_fields', None) or [f'f{at}' for at in range(len(value))]
    for name, each in zip(names, value, strict=True):
        is_tuple = isinstance(each, tuple)
        if is_tuple and not each:
            continue  # it has no column
        if is_tuple and row.dtype[name].names:
            put(row[name], each)
        else:
            row[name] = each


def program_rows(controllers: Rows) -> Rows:
    """Return the constants of the control program, in its types, for rows of ``controller``."""
    rows = np.zeros(len(controllers), row_type(ProgramConstants))
    autonomous = choice(ControllerParameters, 'mode', 'autonomous')
    for name in rows.dtype.names or ():
        is_mode = name == 'autonomous'
        rows[name] = controllers['mode'] == autonomous if is_mode else controllers[name]
    return rows


class RobotRows:
    """The parameters of many robots that differ in some values.

    A parameter that is unknown or none of a robot, or a value that is not allowed, is a
    ParameterError.

    Parameters
    ----------
    parameters : ParameterSet
        Those that all robots have, unless `values` has others.
    values : mapping of str to ndarray
        By ``node.param``: a value for each robot, shape (count,), or (count, 4) for ``k_f``.
    """

    def __init__(self, parameters: ParameterSet, values: Mapping[str, Column], count: int) -> None:
        self._tables = {
            cls.node: np.repeat(_row(parameters.of(cls)), count) for cls in ROBOT_CLASSES
        }
        for target, column in values.items():
            self._set(target, column)

    def __getitem__(self, cls: type[NodeParameters]) -> Rows:
        """Return the table of a node."""
        return self._tables[cls.node]

    def part(self, robots: slice) -> RobotRows:
        """Return the rows of some robots, in the same memory."""
        part = copy(self)
        part._tables = {node: table[robots] for node, table in self._tables.items()}
        return part

    def _set(self, target: str, column: Column) -> None:
        parameter = robot_parameter(target)
        check_values(parameter, target, column)
        whole, element = split_element(target)
        for node in parameter.nodes:
            table = self._tables.get(node)
            name = whole.partition('.')[2]
            if table is None or name not in (table.dtype.names or ()):
                continue
            if parameter.choices and isinstance(parameter.default, str):
                column = np.array([parameter.choices.index(each) for each in column.tolist()])
            if element is None:
                table[name] = column
            else:
                table[name][:, element] = column


def split_element(target: str) -> tuple[str, int | None]:
    """Return ``node.param`` and the index of an element, or None for a whole parameter.

    The elements of the gains are ``controller.k_f.1`` ... ``controller.k_f.4``.
    """
    whole, _, number = target.rpartition('.')
    node, _, name = whole.partition('.')
    known = parameters_of(node).get(name) if node in ALL_NODES else None
    if known is None or not isinstance(known.default, tuple):
        return target, None
    numbers = [str(each) for each in range(1, len(known.default) + 1)]
    if number not in numbers:
        raise ParameterError(
            f'{whole} has no element {number!r}: its elements are 1 … {len(numbers)}'
        )
    return whole, numbers.index(number)


def whole_values(parameters: ParameterSet, values: Mapping[str, object]) -> dict[str, object]:
    """Return values by ``node.param``; elements are put into the parameter that they belong to.

    The other elements are those of `parameters`, or of an earlier one of the values.
    """
    wholes: dict[str, object] = {}
    for target, value in values.items():
        whole, element = split_element(target)
        if element is None:
            wholes[target] = value
            continue
        node, _, name = whole.partition('.')
        before = wholes.get(whole, parameters.of_node(node).values()[name])
        elements = list(cast('Sequence[object]', before))
        elements[element] = value
        wholes[whole] = elements
    return wholes


def robot_parameter(target: str) -> Parameter:
    """Return the parameter of a robot that has the name ``node.param``.

    For an element, such as ``controller.k_f.1``, it is a parameter of one number. It raises
    ParameterError, on one line, if there is none.
    """
    whole, element = split_element(target)
    node, _, name = whole.partition('.')
    if node not in {cls.node for cls in ROBOT_CLASSES}:
        nodes = ', '.join(cls.node for cls in ROBOT_CLASSES)
        raise ParameterError(f'{target}: not a parameter of one of {nodes}')
    known = parameters_of(node)
    if name not in known:
        raise ParameterError(f'{node} has no parameter {name!r}; {suggest(name, known)}')
    parameter = known[name]
    if isinstance(parameter.default, str) and not parameter.choices:
        raise ParameterError(f'{target}: must be the same for all runs of a study')
    if element is None:
        return parameter
    assert isinstance(parameter.default, tuple)
    default = parameter.default[element]
    return replace(parameter, name=f'{name}.{element + 1}', default=default)


def check_values(parameter: Parameter, target: str, column: Column) -> None:
    """Raise ParameterError if a value of a column is not allowed; the message names its run."""
    for run in _doubtful(parameter, column):
        value = column[run]
        plain = value.tolist() if isinstance(value, np.generic | np.ndarray) else value
        try:
            parameter.check(plain, f'{target.partition(".")[0]}.')
        except ParameterError as error:
            raise ParameterError(f'{error} (run {run})') from None


def _doubtful(parameter: Parameter, column: Column) -> Sequence[int]:
    """Return the rows of which one is not allowed if any is."""
    is_range = column.dtype.kind in 'iuf' and not (parameter.choices or parameter.or_zero)
    if not is_range or column.ndim > 1 or not len(column):
        return range(len(column))
    # A NaN counts as an extreme.
    broken = np.flatnonzero(column % 1) if isinstance(parameter.default, int) else ()
    return [int(np.argmin(column)), int(np.argmax(column)), *map(int, broken[:1])]


def _row(parameters: NodeParameters) -> Rows:
    """Return the parameters of a node as a table of one row."""
    cls: Any = type(parameters)
    row = np.zeros(1, row_type(cls))
    for name in row.dtype.names or ():
        value = getattr(parameters, name)
        row[name] = choice(cls, name, value) if isinstance(value, str) else value
    return row
