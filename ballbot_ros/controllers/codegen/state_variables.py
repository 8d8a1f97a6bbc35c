"""The generated program's shared data: one table for C types, data dictionary and comparison."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass

from ballbot_ros.controllers.document.program import ControlProgram
from ballbot_ros.robot.brick.bluetooth import PACKET_SIZE, GamepadPacket

_ZEROS = {'float': '0.0f', 'S32': '0', 'U32': '0U', 'U8': '0U'}


@dataclass(frozen=True)
class StateVariable:
    """A variable of the generated program.

    The member of the C structure and the Python program's attribute have the same name. The type is
    that of the member, or of each of its elements; `initial` is the C expression that task_init
    assigns to them, zero by default. The other texts are for the data dictionary.
    """

    name: str
    c_type: str
    unit: str
    scaling: str
    description: str
    source: str
    length: int = 1
    initial: str = ''

    def __post_init__(self) -> None:
        if not self.initial:
            object.__setattr__(self, 'initial', _ZEROS[self.c_type])


def _floats(*rows: tuple[str, str, str, str]) -> tuple[StateVariable, ...]:
    return tuple(StateVariable(row[0], 'float', row[1], '1', *row[2:]) for row in rows)


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
    StateVariable('battery', 'float', 'mV', '1', 'averaged battery voltage', '7.6'),
    StateVariable('distance_cm', 'S32', 'cm', '1', 'distance to an obstacle; 255: none', '7.5',
                  initial='NO_ECHO_CM'),
    StateVariable('start_time', 'U32', 'ms', '1', 'system time of task_init', '7.3'),
    StateVariable('timer_stop', 'U32', 'ms', '1', 'when the robot was last under control', '7.6'),
    StateVariable('echo_time', 'U32', 'ms', '1', 'system time of the last echo', 'project'),
    StateVariable('control_mode', 'U8', '', '0 stop, 1 calibration, 2 control', 'mode of task ts1',
                  '7.6', initial='BALLBOT_CALIBRATION'),
    StateVariable('flag_avoid', 'U8', '', '0 no, 1 yes', 'an obstacle is near', '7.5'),
    StateVariable('flag_auto', 'U8', '', '0 no, 1 yes', 'time_auto has passed', '7.6'),
    StateVariable('calibrated', 'U8', '', '0 no, 1 yes', 'time_start had passed at the last ts3',
                  '7.6'),
    StateVariable('log_counter', 'U8', 'ticks', '1', 'ticks since the last log packet', '7.4'),
    StateVariable('bluetooth_rx', 'U8', '%', 'int8 in bytes 0 and 1, the rest 0',
                  'newest gamepad packet: left vertical, right horizontal', '7.5', PACKET_SIZE),
)  # fmt: skip

_LETTERS = {'float': 'f', 'S32': 'i', 'U32': 'I', 'U8': 'B'}


def _format(variables: Sequence[StateVariable]) -> str:
    return ''.join(
        f'{variable.length}s' if variable.length > 1 else _LETTERS[variable.c_type]
        for variable in variables
    )


_PLANE = struct.Struct('<' + _format(PLANE_VARIABLES))
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
    rest = [_value(program, variable.name) for variable in PROGRAM_VARIABLES]
    return _MEMBERS.pack(*planes, *rest)


def _value(program: ControlProgram, name: str) -> object:
    state = program.state
    if name == 'bluetooth_rx':
        return GamepadPacket(state.vertical, state.horizontal).encode()
    return getattr(state, name)


def members(state: bytes) -> bytes:
    """Return a C structure without its padding."""
    return state[: _MEMBERS.size]


def named_values(state: bytes) -> dict[str, float]:
    """Return every member of a C structure by its name in C, such as ``x.theta``."""
    names = [f'{plane}.{variable.name}' for plane in 'xy' for variable in PLANE_VARIABLES]
    names += [variable.name for variable in PROGRAM_VARIABLES]
    return dict(zip(names, _MEMBERS.unpack(members(state)), strict=True))


def plane_values(state: bytes, plane: int) -> dict[str, float]:
    """Return one plane's members by name; plane 0 is x, 1 is y."""
    values = _PLANE.unpack_from(state, plane * _PLANE.size)
    return {variable.name: value for variable, value in zip(PLANE_VARIABLES, values, strict=True)}
