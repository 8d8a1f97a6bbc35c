"""The control program's parameters as C constants, in the types of the Python program."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, fields

import numpy as np

from ballbot_ros.controllers.document.constants import ProgramConstants, Single
from ballbot_ros.controllers.document.tasks import TS1_MS
from ballbot_ros.parameters import CONTROLLER, ControllerParameters, Parameter, parameters_of

_INTEGERS = {
    'U8': (0, 2**8 - 1),
    'S8': (-(2**7), 2**7 - 1),
    'U16': (0, 2**16 - 1),
    'S16': (-(2**15), 2**15 - 1),
    'U32': (0, 2**32 - 1),
    'S32': (-(2**31), 2**31 - 1),
}
_NAMES = {'sound_freq': 'sound_frq'}
"""C names, from the source document, of parameters whose own names are platform functions."""
_OIL_PARAMETERS = ('ts2_period', 'ts3_period')


@dataclass(frozen=True)
class CParameter:
    """A constant of the generated program, and its line in the data dictionary."""

    name: str
    c_type: str
    c_value: str
    length: int
    unit: str
    scaling: str
    description: str
    source: str

    @property
    def declarator(self) -> str:
        """Name, with the length of an array."""
        return f'{self.name}[{self.length}]' if self.length > 1 else self.name

    @property
    def text(self) -> str:
        """The value without C syntax."""
        return self.c_value.strip('{}').replace('f', '').removesuffix('U')

    @property
    def comment(self) -> str:
        """Meaning and unit."""
        unit = '' if self.unit in ('', '1') else f' [{self.unit}]'
        return self.description + unit


def c_parameters(parameters: ControllerParameters) -> list[CParameter]:
    """Return the constants for the parameters of the node ``controller``."""
    typed = ProgramConstants.of(parameters)
    rows = parameters_of(CONTROLLER)
    constants = [
        CParameter(
            'ts1', 'float', c_float(Single(TS1_MS)), 1, 'ms', '1', 'period of task_ts1', '7.4'
        )
    ]
    for field in fields(ProgramConstants):
        if field.name in _OIL_PARAMETERS:
            continue
        value = getattr(typed, field.name)
        if field.name == 'autonomous':
            constants.append(_mode(value, rows['mode']))
        else:
            constants.append(_constant(rows[field.name], value))
    return constants


def parameter_hash(parameters: ControllerParameters) -> str:
    """Return a hash of all constants and tasks of the generated program."""
    lines = [f'{each.declarator}={each.c_value}' for each in c_parameters(parameters)]
    text = '\n'.join([*lines, *map(str, ProgramConstants.of(parameters).tasks)])
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def c_float(value: Single) -> str:
    """Return the shortest constant that rounds to exactly `value` in single precision."""
    text = str(value)
    return f'{text}f' if any(mark in text for mark in '.e') else f'{text}.0f'


def _mode(autonomous: bool, row: Parameter) -> CParameter:
    return CParameter(
        'autonomous', 'U8', f'{int(autonomous)}U', 1, '', '0 remote, 1 autonomous',
        row.description, row.source,
    )  # fmt: skip


def _constant(row: Parameter, value: Single | int | tuple[Single, ...]) -> CParameter:
    if isinstance(value, tuple):
        c_type, length = 'float', len(value)
        c_value = f'{{{", ".join(map(c_float, value))}}}'
    elif isinstance(value, np.floating):
        c_type, length, c_value = 'float', 1, c_float(value)
    else:
        c_type, length = _integer_type(row), 1
        c_value = f'{value}U' if c_type.startswith('U') else str(value)
    return CParameter(
        _NAMES.get(row.name, row.name), c_type, c_value, length, row.unit, '1',
        row.description, row.source,
    )  # fmt: skip


def _integer_type(row: Parameter) -> str:
    """Return the smallest type for all values of the parameter."""
    assert row.bounds is not None
    low, high = row.bounds
    return next(name for name, (least, most) in _INTEGERS.items() if least <= low and high <= most)
