"""Parameters of many robots as rows of tables, one table a node."""

from __future__ import annotations

from dataclasses import fields
from typing import Any, Literal, get_args, get_origin, get_type_hints

import numpy as np
from numpy.typing import NDArray

from ballbot_ros.controllers.document.constants import ProgramConstants, Single
from ballbot_ros.parameters import ControllerParameters, NodeParameters

Rows = NDArray[np.void]
"""A structured array; its fields have the names of the parameters."""

_NUMBERS: dict[Any, str] = {float: 'f8', int: 'i8', bool: '?', Single: 'f4'}


def row_type(cls: type) -> np.dtype[np.void]:
    """Return the type of a row for a dataclass: its numbers, switches, and choices by their index.

    Texts that are no choices are left out.
    """
    columns: list[Any] = []
    hints = get_type_hints(cls)
    for each in fields(cls):
        kind = hints[each.name]
        if kind in _NUMBERS:
            columns.append((each.name, _NUMBERS[kind]))
        elif get_origin(kind) is tuple and set(get_args(kind)) <= {float, Single}:
            columns.append((each.name, _NUMBERS[get_args(kind)[0]], (len(get_args(kind)),)))
        elif get_origin(kind) is Literal and isinstance(get_args(kind)[0], int):
            columns.append((each.name, 'i8'))
        elif get_origin(kind) is Literal:
            columns.append((each.name, 'i1'))
    return np.dtype(columns)


def choice(cls: type, name: str, value: str) -> int:
    """Return the number that stands for a value of a choice in the rows of a dataclass."""
    return get_args(get_type_hints(cls)[name]).index(value)


def rows_of(parameters: NodeParameters, count: int) -> Rows:
    """Return a table with `count` equal rows: the parameters of a node."""
    cls = type(parameters)
    row = np.zeros(1, row_type(cls))
    names = row.dtype.names or ()
    for name in names:
        value = getattr(parameters, name)
        row[name] = choice(cls, name, value) if isinstance(value, str) else value
    return np.repeat(row, count)


def program_rows(controllers: Rows) -> Rows:
    """Return the constants of the control program, in its types, for the rows of ``controller``."""
    rows = np.zeros(len(controllers), row_type(ProgramConstants))
    for name in rows.dtype.names or ():
        if name == 'autonomous':
            autonomous = choice(ControllerParameters, 'mode', 'autonomous')
            rows[name] = controllers['mode'] == autonomous
        else:
            rows[name] = controllers[name]
    return rows
