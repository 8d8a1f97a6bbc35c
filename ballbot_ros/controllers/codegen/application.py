"""The nxtOSEK application folder, its description, and the table of its shared data."""

from __future__ import annotations

import hashlib
import re
import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np
from jinja2 import Environment, FileSystemLoader, StrictUndefined

from ballbot_ros import __version__
from ballbot_ros.controllers.document.axis import PROGRAM_NAME, TS1_MS, ProgramConstants, Single
from ballbot_ros.controllers.document.program import (
    LOG_DUTIES,
    LOG_GYROS,
    LOWEST_TONE_HZ,
    VOLTAGE_OFFSET,
    VOLTAGE_SLOPE,
    ControlProgram,
)
from ballbot_ros.errors import CodegenError
from ballbot_ros.files import program, read_bytes, read_text
from ballbot_ros.parameters import CONTROLLER, ControllerParameters, Parameter, parameters_of
from ballbot_ros.parameters.files import values_text
from ballbot_ros.robot.brick.bluetooth import PACKET_SIZE
from ballbot_ros.robot.brick.schedule import TaskTiming
from ballbot_ros.robot.brick.sensors import NO_ECHO_CM


@dataclass(frozen=True)
class CVariable:
    """A variable or constant of the generated program, and its line in the data dictionary.

    A variable has the name of the Python program's attribute. The type is that of the variable, or
    of each of its elements; `initial` is the C expression that is assigned to them.
    """

    name: str
    c_type: str
    initial: str
    unit: str
    scaling: str
    description: str
    source: str
    length: int = 1

    @property
    def declarator(self) -> str:
        """Name, with the length of an array."""
        return f'{self.name}[{self.length}]' if self.length > 1 else self.name

    @property
    def text(self) -> str:
        """The value without C syntax."""
        return self.initial.strip('{}').replace('f', '').removesuffix('U')

    @property
    def comment(self) -> str:
        """Meaning and unit."""
        unit = '' if self.unit in ('', '1') else f' [{self.unit}]'
        return self.description + unit


def _floats(*rows: tuple[str, str, str, str]) -> tuple[CVariable, ...]:
    return tuple(CVariable(row[0], 'float', '0.0f', row[1], '1', *row[2:]) for row in rows)


PLANE_VARIABLES = _floats(
    ('gyro_offset', 'deg/s', 'estimate of the gyro reading at rest', '7.4'),
    ('theta', 'deg', 'estimated ball angle', '7.4'),
    ('psi', 'deg', 'estimated body pitch', '7.4'),
    ('theta_dot', 'deg/s', 'estimated ball rate', '7.4'),
    ('psi_dot', 'deg/s', 'estimated pitch rate', '7.4'),
    ('theta_ref', 'deg', 'reference of the ball angle', '7.4'),
    ('theta_ref_dot', 'deg/s', 'reference of the ball rate, low-passed', '7.4'),
    ('theta_diff', 'deg', 'reference minus estimate of the ball angle', '7.4'),
    ('psi_diff', 'deg', 'reference minus estimate of the pitch', '7.4'),
    ('sum_theta_ref_dot', 'deg/s', 'sum whose product with the period is theta_ref', '7.4'),
    ('sum_psi_dot', 'deg/s', 'sum whose product with the period is psi', '7.4'),
    ('sum_theta_diff', 'deg', 'sum whose product with the period is the integral', '7.4'),
    ('theta_smooth', 'deg', 'low-passed ball angle, whose difference is the rate', '7.4'),
)
"""Data of one plane; `ballbot.x` and `ballbot.y` in C, `program.x` and `program.y` in Python."""

PROGRAM_VARIABLES = (
    CVariable('battery', 'float', '0.0f', 'mV', '1', 'averaged battery voltage', '7.6'),
    CVariable('distance_cm', 'S32', 'NO_ECHO_CM', 'cm', '1',
              'distance to an obstacle; 255: none', '7.5'),
    CVariable('start_time', 'U32', '0U', 'ms', '1', 'system time of task_init', '7.3'),
    CVariable('timer_stop', 'U32', '0U', 'ms', '1', 'when the robot was last under control', '7.6'),
    CVariable('echo_time', 'U32', '0U', 'ms', '1', 'system time of the last echo', 'project'),
    CVariable('control_mode', 'U8', 'BALLBOT_CALIBRATION', '', '0 stop, 1 calibration, 2 control',
              'mode of task ts1', '7.6'),
    CVariable('flag_avoid', 'U8', '0U', '', '0 no, 1 yes', 'an obstacle is near', '7.5'),
    CVariable('flag_auto', 'U8', '0U', '', '0 no, 1 yes', 'time_auto has passed', '7.6'),
    CVariable('calibrated', 'U8', '0U', '', '0 no, 1 yes', 'time_start had passed at the last ts3',
              '7.6'),
    CVariable('log_counter', 'U8', '0U', 'ticks', '1', 'ticks since the last log packet', '7.4'),
    CVariable('bluetooth_rx', 'U8', '0U', '%', 'int8 in bytes 0 and 1, the rest 0',
              'newest gamepad packet: left vertical, right horizontal', '7.5', PACKET_SIZE),
)  # fmt: skip

_LETTERS = {'float': 'f', 'S32': 'i', 'U32': 'I', 'U8': 'B'}


def _format(variables: Sequence[CVariable]) -> str:
    return ''.join(
        f'{variable.length}s' if variable.length > 1 else _LETTERS[variable.c_type]
        for variable in variables
    )


_MEMBERS = struct.Struct('<' + 2 * _format(PLANE_VARIABLES) + _format(PROGRAM_VARIABLES))
STATE_SIZE = (_MEMBERS.size + 3) // 4 * 4
"""Size of the C structure, including padding at the end."""


def state_bytes(program: ControlProgram) -> bytes:
    """Return the Python program's data in the layout of the C structure, without padding."""
    planes = [
        getattr(plane, variable.name)
        for plane in (program.x, program.y)
        for variable in PLANE_VARIABLES
    ]
    state = program.state
    packet = struct.pack('bb', state.vertical, state.horizontal)  # the rest is 0
    rest = [
        packet if each.name == 'bluetooth_rx' else getattr(state, each.name)
        for each in PROGRAM_VARIABLES
    ]
    return _MEMBERS.pack(*planes, *rest)


def members(state: bytes) -> bytes:
    """Return a C structure without its padding."""
    return state[: _MEMBERS.size]


def named_values(state: bytes) -> dict[str, float]:
    """Return every member of a C structure by its name in C, such as ``x.theta``."""
    names = [f'{plane}.{variable.name}' for plane in 'xy' for variable in PLANE_VARIABLES]
    names += [variable.name for variable in PROGRAM_VARIABLES]
    return dict(zip(names, _MEMBERS.unpack(members(state)), strict=True))


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
_CHOICES = {'autonomous': 'mode', 'log_content': 'log_content'}
"""Constants that are the numbers of choices, and the parameters that have these."""
_OIL_PARAMETERS = ('ts2_period', 'ts3_period')


def c_parameters(parameters: ControllerParameters) -> list[CVariable]:
    """Return the constants for the parameters of the node ``controller``."""
    typed = ProgramConstants.of(parameters)
    rows = parameters_of(CONTROLLER)
    period = _c_float(Single(TS1_MS))
    constants = [CVariable('ts1', 'float', period, 'ms', '1', 'period of task_ts1', '7.4')]
    for field in fields(ProgramConstants):
        if field.name in _OIL_PARAMETERS:
            continue
        value = getattr(typed, field.name)
        if field.name in _CHOICES:
            row = rows[_CHOICES[field.name]]
            text = ', '.join(f'{number} {choice}' for number, choice in enumerate(row.choices))
            constants.append(
                CVariable(field.name, 'U8', f'{value:d}U', '', text, row.description, row.source)
            )
        else:
            constants.append(_constant(rows[field.name], value))
    return constants


def parameter_hash(parameters: ControllerParameters) -> str:
    """Return a hash of all constants and tasks of the generated program."""
    lines = [f'{each.declarator}={each.initial}' for each in c_parameters(parameters)]
    text = '\n'.join([*lines, *map(str, ProgramConstants.of(parameters).tasks)])
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def _c_float(value: Single) -> str:
    """Return the shortest constant that rounds to exactly `value` in single precision."""
    text = str(value)
    return f'{text}f' if any(mark in text for mark in '.e') else f'{text}.0f'


def _constant(row: Parameter, value: Single | int | tuple[Single, ...]) -> CVariable:
    c_type, length = 'float', 1
    if isinstance(value, tuple):
        length, c_value = len(value), f'{{{", ".join(map(_c_float, value))}}}'
    elif isinstance(value, np.floating):
        c_value = _c_float(value)
    else:
        assert row.bounds is not None
        low, high = row.bounds
        # The smallest type for all values of the parameter.
        c_type = next(
            name for name, (least, most) in _INTEGERS.items() if least <= low and high <= most
        )
        c_value = f'{value}U' if c_type.startswith('U') else str(value)
    return CVariable(
        _NAMES.get(row.name, row.name), c_type, c_value, row.unit, '1',
        row.description, row.source, length,
    )  # fmt: skip


PARAMETER_FILE = 'parameters.yaml'
OIL_FILE = 'ballbot.oil'
C_SOURCES = ('ballbot_controller.c', 'ballbot_parameters.c', 'ballbot_app.c')
TEMPLATES = (
    *C_SOURCES,
    'ballbot_controller.h',
    'ballbot_parameters.h',
    OIL_FILE,
    'Makefile',
    'README.md',
    'DATA_DICTIONARY.md',
)
TEMPLATE_FOLDER = Path(__file__).parent / 'templates'
CODE_TEMPLATES = ('ballbot_app.c', 'ballbot_controller.c', 'ballbot_controller.h')
"""Templates whose text is the program; the others have its parameters, or describe it."""

TIMES_FILE = 'times.yaml'
"""Instructions of the program's paths, written by a check."""

STACK_BYTES = 512
"""Stack of each task in the OIL file."""
_STAMP = b'Generated by ballbot_ros'
"""Start of the stamp in every file."""

_TASK = re.compile(r'TASK\s+(\w+)\s*\{\s*PRIORITY\s*=\s*(\d+)\s*;')
_ALARM = re.compile(r'TASK\s*=\s*(\w+)\s*;.*?CYCLETIME\s*=\s*(\d+)\s*;', re.DOTALL)


def application_files(
    parameters: ControllerParameters, folder: Path | None = None
) -> dict[str, str]:
    """Return the text of every file of the application, by name.

    Equal parameters give equal text, and a README whose commands run in `folder`.
    """
    environment = Environment(
        loader=FileSystemLoader(TEMPLATE_FOLDER),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    stamp = _stamp(parameters)
    tasks = ProgramConstants.of(parameters).tasks
    context = {
        'stamp': stamp,
        'ballbot': program(folder=folder),
        'parameters': c_parameters(parameters),
        'plane_variables': PLANE_VARIABLES,
        'program_variables': PROGRAM_VARIABLES,
        'tasks': tasks,
        'periods': {task.name: task.period_ms for task in tasks},
        'stack_size': STACK_BYTES,
        'mode': parameters.mode,
        'time_start': parameters.time_start,
        'program_name': PROGRAM_NAME,
        'packet_size': PACKET_SIZE,
        'no_echo_cm': NO_ECHO_CM,
        'log_duties': LOG_DUTIES,
        'log_gyros': LOG_GYROS,
        'lowest_tone_hz': LOWEST_TONE_HZ,
        'voltage_slope': _c_float(VOLTAGE_SLOPE),
        'voltage_offset': _c_float(VOLTAGE_OFFSET),
    }
    files = {name: environment.get_template(name).render(context) for name in TEMPLATES}
    names = ['mode', *(field.name for field in fields(ProgramConstants))]
    values = {name: getattr(parameters, name) for name in names if hasattr(parameters, name)}
    return {**files, PARAMETER_FILE: f'# {stamp}\n{values_text({CONTROLLER: values})}'}


def _stamp(parameters: ControllerParameters) -> str:
    return f'{_STAMP.decode()} {__version__}, parameters {parameter_hash(parameters)}.'


def write_application(folder: Path, parameters: ControllerParameters) -> list[Path]:
    """Write the application, replacing an earlier one; return the files.

    Raises
    ------
    CodegenError
        If the folder can't be written, or a file to replace was not written by `ballbot codegen`.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise CodegenError(f'{error.filename or folder}: {error.strerror}') from None
    return _write(folder, application_files(parameters, folder))


def _write(folder: Path, files: Mapping[str, str]) -> list[Path]:
    """Write files into a folder, unless one of them replaces a file that was not generated."""
    texts = {folder / name: text for name, text in files.items()}
    try:
        for path in texts:
            if path.exists() and _STAMP not in read_bytes(path):
                raise CodegenError(
                    f'{path}: not overwritten, because ballbot codegen did not write it; choose '
                    'another folder'
                )
        for path, text in texts.items():
            path.write_text(text, encoding='utf-8')
    except OSError as error:
        raise CodegenError(f'{error.filename or folder}: {error.strerror}') from None
    return list(texts)


def program_sha256() -> str:
    """Return the SHA-256 of the text of the C templates: of the program without parameters."""
    text = ''.join(read_text(TEMPLATE_FOLDER / name) for name in CODE_TEMPLATES)
    return hashlib.sha256(text.encode()).hexdigest()


def write_times(
    folder: Path, parameters: ControllerParameters, instructions: Mapping[str, int]
) -> Path:
    """Write a parameter file with the counted instructions, and the hash of the program.

    Raises
    ------
    CodegenError
        As :func:`write_application`.
    """
    text = (
        f'# {_stamp(parameters)}\n'
        '# Most instructions of each path of the program, counted by ballbot codegen --check.\n'
        + values_text({CONTROLLER: {**instructions, 'times_of': program_sha256()[:16]}})
    )
    (path,) = _write(folder, {TIMES_FILE: text})
    return path


def read_tasks(folder: Path) -> list[TaskTiming]:
    """Return the tasks of a folder's OIL file, in file order.

    Raises
    ------
    CodegenError
        If the file can't be read, has no tasks, or has an alarm for an unknown task.
    """
    path = folder / OIL_FILE
    try:
        text = read_text(path)
    except (OSError, UnicodeError) as error:
        reason = getattr(error, 'strerror', None) or 'not UTF-8 text'
        raise CodegenError(f'{path}: {reason}') from None
    text = re.sub(r'/\*.*?\*/', '', text, flags=re.DOTALL)
    tasks = {name: int(priority) for name, priority in _TASK.findall(text)}
    periods = {name: int(period) for name, period in _ALARM.findall(text)}
    if not tasks or not periods.keys() <= tasks.keys():
        raise CodegenError(f'{path}: no tasks with PRIORITY, or an alarm for an unknown task')
    return [TaskTiming(name, tasks[name], periods.get(name, 0)) for name in tasks]
