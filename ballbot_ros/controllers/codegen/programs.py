"""The programs that can be generated as C: their data, constants and counterparts in Python."""

from __future__ import annotations

import struct
from collections.abc import Mapping
from dataclasses import fields, replace
from typing import Any

import numpy as np

from ballbot_ros.controllers import commissioning
from ballbot_ros.controllers.codegen.compiled_program import CompiledProgram
from ballbot_ros.controllers.codegen.generated_program import CVariable, GeneratedProgram
from ballbot_ros.controllers.document.axis import (
    LCD_MS,
    PROGRAM_NAME,
    TASK_TS1,
    TS1_MS,
    ProgramConstants,
    Single,
)
from ballbot_ros.controllers.document.program import (
    LOG_DUTIES,
    LOG_GYROS,
    LOWEST_TONE_HZ,
    TASK_NUMBERS,
    VOLTAGE_OFFSET,
    VOLTAGE_SLOPE,
    ControlMode,
    ControlProgram,
    job_time,
    operating_state,
)
from ballbot_ros.controllers.interface import Estimates
from ballbot_ros.parameters import CONTROLLER, ControllerParameters, Parameter, Value, parameters_of
from ballbot_ros.parameters.controller import USER
from ballbot_ros.robot.brick.bluetooth import PACKET_SIZE
from ballbot_ros.robot.brick.brick import DeviceOutputs
from ballbot_ros.robot.brick.job_times import JobTimes
from ballbot_ros.robot.brick.schedule import TaskTiming
from ballbot_ros.robot.brick.sensors import NO_ECHO_CM


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


def _settings(parameters: ControllerParameters) -> dict[str, Value]:
    names = ['mode', *(field.name for field in fields(ProgramConstants))]
    return {name: getattr(parameters, name) for name in names if hasattr(parameters, name)}


def _context(parameters: ControllerParameters) -> Mapping[str, object]:
    return {
        'mode': parameters.mode,
        'time_start': parameters.time_start,
        'plane_variables': PLANE_VARIABLES,
        'program_variables': PROGRAM_VARIABLES,
        'no_echo_cm': NO_ECHO_CM,
        'log_duties': LOG_DUTIES,
        'log_gyros': LOG_GYROS,
        'lowest_tone_hz': LOWEST_TONE_HZ,
        'voltage_slope': _c_float(VOLTAGE_SLOPE),
        'voltage_offset': _c_float(VOLTAGE_OFFSET),
    }


def _state_of(program: ControlProgram) -> list[Any]:
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
    return planes + rest


_ESTIMATES = [[f'{plane}.{each.name}' for each in fields(Estimates)] for plane in 'xy']


class CompiledBalance(CompiledProgram):
    """The document's program as C."""

    x = y = Estimates(*[0.0] * len(fields(Estimates)))
    control_mode = ControlMode.CALIBRATION

    @property
    def reads_packets(self) -> bool:
        """Whether its next tick takes a packet from the radio."""
        return self.control_mode == ControlMode.CONTROL

    def job_time(self, task: str, outputs: DeviceOutputs, times: JobTimes) -> float:
        """Return how long the job takes that has just run [µs]."""
        number = TASK_NUMBERS[task]
        return job_time(times, number, self.control_mode, bool(outputs.log), bool(outputs.tones))

    def _publish(self, values: Mapping[str, Any]) -> None:
        self.x, self.y = (Estimates(*(values[name] for name in plane)) for plane in _ESTIMATES)
        self.control_mode = ControlMode(int(values['control_mode']))
        self.operating_state = operating_state(
            self.control_mode,
            self._parameters.mode == 'autonomous',
            bool(values['flag_avoid']),
            bool(values['flag_auto']),
        )


BALANCE = GeneratedProgram(
    name='balance',
    title=PROGRAM_NAME,
    image='ballbot',
    implementation='python',
    variables=(
        *(
            replace(variable, name=f'{plane}.{variable.name}')
            for plane in 'xy'
            for variable in PLANE_VARIABLES
        ),
        *PROGRAM_VARIABLES,
    ),
    constants=c_parameters,
    tasks=lambda parameters: ProgramConstants.of(parameters).tasks,
    settings=_settings,
    context=_context,
    state_of=_state_of,
    compiled=CompiledBalance,
)
"""The document's program."""

_MEANINGS = {
    'phase_ticks': 'length of each phase but the last',
    'port_ticks': 'length of a pulse on one motor alone, and of the pause after it',
    'step_ticks': 'time for which the ramp holds each duty',
    'play_ticks': 'length of a pulse for the gear play, and of the pause after it',
    'tilt_ticks': 'time to tilt the robot into each direction',
    'port_duty': 'duty of a pulse on one motor alone',
    'play_duty': 'duty of the first pulses for the gear play',
}


def _own(parameters: ControllerParameters) -> dict[str, Value]:
    return {name: value for name, value in parameters.own if name.startswith(USER)}


def _phase_values(parameters: ControllerParameters) -> commissioning.Constants:
    user: Any = {name.removeprefix(USER): value for name, value in _own(parameters).items()}
    return commissioning.Commissioning.constants(commissioning.CommissioningParameters(**user))


def _phase_constants(parameters: ControllerParameters) -> list[CVariable]:
    constants = []
    for name, value in _phase_values(parameters)._asdict().items():
        numbers = value if isinstance(value, tuple) else (value,)
        c_type, unit, suffix = ('S8', '%', '') if 'duty' in name else ('U32', 'ticks', 'U')
        text = ', '.join(f'{number}{suffix}' for number in numbers)
        initial = f'{{{text}}}' if len(numbers) > 1 else text
        row = initial, unit, '1', _MEANINGS[name], 'project', len(numbers)
        constants.append(CVariable(name, c_type, *row))
    return constants


COMMISSIONING = GeneratedProgram(
    name='commissioning',
    title=commissioning.NAME,
    image='commissioning',
    implementation='commissioning',
    variables=(
        CVariable('ticks', 'U32', '0U', 'ticks', '1', 'ticks of the phase so far', 'project'),
        CVariable('phase', 'U8', '0U', '',
                  '0 pause, 1 rest, 2 ports, 3 ramp, 4 play, 5 tilt, 6 end',
                  'phase of the program', 'project'),
        CVariable('log_counter', 'U8', '0U', 'ticks', '1', 'ticks since the last log packet',
                  'project'),
    ),
    constants=_phase_constants,
    tasks=lambda _: (
        TaskTiming('task_init', 5, 0),
        TaskTiming(TASK_TS1, 4, TS1_MS),
        TaskTiming('task_lcd', 1, LCD_MS),
    ),
    settings=lambda parameters: {
        'implementation': 'commissioning', 'log_content': 'duties_and_gyros', **_own(parameters)
    },
    context=lambda parameters: {'commissioning': commissioning, 'own': _own(parameters)},
    state_of=lambda program: program.controller.state,
    compiled=CompiledProgram,
    duration=lambda parameters: sum(_phase_values(parameters).phase_ticks),
)  # fmt: skip
"""The program that measures gyros and motors of a robot on a stand."""

PROGRAMS = {each.name: each for each in (BALANCE, COMMISSIONING)}
"""The programs by the value of ``--program``."""


def program_of(parameters: ControllerParameters) -> GeneratedProgram:
    """Return the program that parameters are for; the document's if they are for no other."""
    found = {each.implementation: each for each in PROGRAMS.values()}
    return found.get(parameters.implementation, BALANCE)
