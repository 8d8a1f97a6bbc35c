"""Every parameter of the ballbot: one table, and the checks that follow from it.

The ROS declarations, the validation of parameter files, ``config/ballbot.yaml`` and
``docs/parameters.md`` are all made from :data:`TABLE`. Plant and recording values are SI; the
parameters of the brick and its devices are in the brick's own units, as the unit column says.
Sections and equations are those of Yamamoto, *NXT Ballbot Model-Based Design* (2009).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields
from difflib import get_close_matches
from enum import Enum
from typing import Any, TypeVar

from ballbot_ros.errors import BallbotError

Value = bool | int | float | str | tuple[float, ...]

PLANT, GYRO, ENCODER, SONAR, CONTROLLER, GAMEPAD, RECORDER = NODES = (
    'plant_sim',
    'gyro_driver',
    'encoder_driver',
    'sonar_driver',
    'controller',
    'gamepad_teleop',
    'recorder',
)
"""The participants of a run."""

PLAYER, VIEWER, VISUALIZER, SUPERVISOR = OPTIONAL_NODES = (
    'player',
    'viewer',
    'robot_visualizer',
    'supervisor',
)
"""Nodes that a run does without."""

ALL_NODES = NODES + OPTIONAL_NODES


class ParameterError(BallbotError):
    """An unknown parameter, or a value of the wrong type or out of bounds."""


class Acts(Enum):
    """From when on a value acts that a running node is given."""

    AT_ONCE = 'at once'
    NEXT_RUN = 'next run'
    NEVER = 'never'


@dataclass(frozen=True)
class Parameter:
    """One row of the table.

    Attributes
    ----------
    nodes : tuple of str
        The nodes that declare it; most have one.
    default : bool, int, float, str or tuple of float
        The default of the ``ideal`` profile; its type is the parameter's type.
    unit : str
        ``'1'`` for a pure number, empty for text and switches.
    bounds : tuple of float or None
        Inclusive lower and upper bound of a number, or of each element of an array.
    or_zero : bool
        Whether 0, which lies out of bounds, is allowed and means something else.
    choices : tuple
        The words a text, or the numbers a whole number may be; empty for any.
    acts : Acts
        From when on a new value acts in a running node; never, where it is read-only.
    """

    nodes: tuple[str, ...]
    name: str
    default: Value
    unit: str
    bounds: tuple[float, float] | None
    or_zero: bool
    choices: tuple[str | int, ...]
    description: str
    source: str
    acts: Acts

    def check(self, value: Any, where: str) -> Value:
        """Return `value` in the parameter's own type.

        Raises
        ------
        ParameterError
            If the type is wrong or the value lies outside the bounds.
        """
        name = f'{where}{self.name}'
        if isinstance(self.default, tuple):
            if not isinstance(value, list | tuple) or len(value) != len(self.default):
                raise ParameterError(
                    f'{name}: {value!r} is not a list of {len(self.default)} numbers'
                )
            return tuple(self._number(item, name) for item in value)
        if isinstance(self.default, bool):
            if not isinstance(value, bool):
                raise ParameterError(f'{name}: {value!r} is not true or false')
            return value
        if isinstance(self.default, str):
            if not isinstance(value, str):
                raise ParameterError(f'{name}: {value!r} is not text')
            if not _is_utf8(value):
                raise ParameterError(f'{name}: {value!r} is not UTF-8')
            return str(self._choice(value, name))
        if isinstance(self.default, int):
            if isinstance(value, float) and value.is_integer():
                value = int(value)
            if isinstance(value, bool) or not isinstance(value, int):
                raise ParameterError(f'{name}: {value!r} is not a whole number')
            return int(self._choice(value, name) if self.choices else self._number(value, name))
        return float(self._number(value, name))

    def _choice(self, value: Any, name: str) -> Any:
        if self.choices and value not in self.choices:
            raise ParameterError(
                f'{name}: {value!r} is not one of {self.choices_text}{self._spaced_unit}'
            )
        return value

    @property
    def choices_text(self) -> str:
        """The choices in words."""
        return ', '.join(map(str, self.choices))

    @property
    def bounds_text(self) -> str:
        """The bounds in words, without the unit."""
        if not self.bounds:
            return ''
        low, high = self.bounds
        return f'{"0 or " if self.or_zero else ""}{low:g} … {high:g}'

    @property
    def _spaced_unit(self) -> str:
        return '' if self.unit in ('', '1') else f' {self.unit}'

    def _number(self, value: Any, name: str) -> float:
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise ParameterError(f'{name}: {value!r} is not a number')
        low, high = self.bounds or (-math.inf, math.inf)
        if not (low <= value <= high or (self.or_zero and value == 0)):
            raise ParameterError(
                f'{name}: {value!r} is not within {self.bounds_text}{self._spaced_unit}'
            )
        return value if isinstance(self.default, int) else float(value)


def _is_utf8(text: str) -> bool:
    """Tell whether ROS can carry a text: no bytes of a name that are no UTF-8, and no NUL."""
    return not any(each == '\0' or '\ud800' <= each <= '\udfff' for each in text)


def _rows(nodes: str | tuple[str, ...], *rows: tuple[Any, ...]) -> list[Parameter]:
    parameters = []
    for name, default, unit, allowed, description, source, *acts in rows:
        is_text = isinstance(default, str)
        or_zero = isinstance(allowed, _OrZero)
        is_choice = allowed is not None and (is_text or len(allowed) > 2)
        parameters.append(
            Parameter(
                nodes=(nodes,) if isinstance(nodes, str) else nodes,
                name=name,
                default=default,
                unit=unit,
                bounds=(allowed[0], allowed[-1]) if allowed and not is_text else None,
                or_zero=or_zero,
                choices=allowed if is_choice else (),
                description=description,
                source=source,
                acts=acts[0] if acts else Acts.NEXT_RUN,
            )
        )
    return parameters


class _OrZero(tuple[float, float]):
    """Bounds beside which 0 is allowed."""

    __slots__ = ()


_ANY = (-1e9, 1e9)
_COEFFICIENT = (0.0, 1.0)
_UINT32 = (0, 2**32 - 1)
# Whole ticks, of which the 100 ms on whose multiples runs begin are a multiple.
_PERIODS = (4, 20, 100)

# name, default, unit, bounds or choices, description, source[, from when on a new value acts]
TABLE: tuple[Parameter, ...] = (
    *_rows(
        (GYRO, SONAR),
        ('seed', 1, '1', (0, 2**63 - 1), 'seed of all device noise of the run', 'project'),
    ),
    *_rows(
        (PLANT, SONAR, VIEWER),
        ('map', '', '', None,
         'map (shipped name or image file); empty: a free floor without end', 'B.2'),
    ),
    *_rows(
        (PLANT, SONAR, VIEWER, VISUALIZER),
        ('body_depth', 0.135, 'm', (0.0, 10.0), 'body depth D, along x', '3.1'),
    ),
    *_rows(
        (PLANT, GAMEPAD),
        ('scenario', '', '', None,
         'scenario (name or file) whose stick signals and pushes act; empty: none', '5.1'),
    ),
    *_rows(
        (PLANT, CONTROLLER, GAMEPAD),
        ('lockstep', True, '', None,
         'true: each tick waits for its inputs; false: wall-clock timers, newest sample wins',
         'project', Acts.NEVER),
    ),
    *_rows(
        (PLANT, CONTROLLER, GAMEPAD, VIEWER, VISUALIZER),
        ('ball_radius', 0.026, 'm', (1e-3, 1.0), 'spherical wheel radius Rs', '3.1'),
    ),
    *_rows(
        (CONTROLLER, GAMEPAD),
        ('k_thetadot', 380.0, 'deg/s', (0.0, 1e4), 'speed reference gain (0.17 m/s)', '7.7'),
        ('gp_max', 100, '%', (1, 127), 'largest stick value', '5.1'),
    ),
    *_rows(
        (PLANT, CONTROLLER, VIEWER, VISUALIZER),
        ('wheel_radius', 0.021, 'm', (1e-3, 1.0), 'motor wheel (rubber tire) radius Rw', '3.1'),
    ),
    *_rows(
        (PLANT, VIEWER, VISUALIZER),
        ('wheel_width', 0.022, 'm', (0.0, 1.0), 'motor wheel height (width of the tire) Lw', '3.1'),
        ('body_width', 0.135, 'm', (0.0, 10.0), 'body width W, along y', '3.1'),
        ('body_height', 0.17, 'm', (1e-3, 10.0),
         'distance L from the ball centre to the body centre', '3.1'),
    ),
    *_rows(
        (PLANT, VISUALIZER),
        ('ball_mass', 0.013, 'kg', (1e-6, 100.0), 'spherical wheel mass Ms', '3.1'),
        ('wheel_mass', 0.015, 'kg', (0.0, 100.0), 'motor wheel mass Mw', '3.1'),
        ('body_mass', 0.682, 'kg', (1e-6, 100.0), 'body mass Mb', '3.1'),
    ),
    *_rows(
        PLANT,
        ('gravity', 9.81, 'm/s²', (0.0, 100.0), 'gravity acceleration g', '3.1'),
        ('motor_inertia', 1e-5, 'kg·m²', (0.0, 1.0), 'DC motor inertia Jm', '3.1'),
        ('motor_resistance', 6.69, 'Ω', (1e-3, 1e3), 'DC motor resistance Rm', '3.1'),
        ('back_emf_constant', 0.468, 'V·s/rad', (0.0, 100.0), 'back EMF constant Kb', '3.1'),
        ('torque_constant', 0.317, 'N·m/A', (0.0, 100.0), 'torque constant Kt', '3.1'),
        ('motor_friction', 0.0022, 'N·m·s/rad', (0.0, 10.0), 'friction body to motor fm', '3.1'),
        ('ball_friction', 0.0, 'N·m·s/rad', (0.0, 10.0), 'friction ball to floor fs', '3.1'),
        ('plant_model', 'linear', '', ('linear', 'nonlinear'),
         'equations of motion: (3.20)-(3.21) or (3.11)-(3.12)', '3.2, 3.3'),
        ('start_pitch_x', 0.0, 'rad', (-1.5, 1.5), 'body pitch at the start, plane x', '8.2'),
        ('start_pitch_y', 0.0, 'rad', (-1.5, 1.5), 'body pitch at the start, plane y', '8.2'),
        ('start_position_x', 0.0, 'm', (-1e3, 1e3), 'ball position at the start, plane x', '3.2'),
        ('start_position_y', 0.0, 'm', (-1e3, 1e3), 'ball position at the start, plane y', '3.2'),
        ('hold_time', 1.0, 's', (0.0, 1e6), 'the robot is held still so long from the start',
         '6.3'),
        ('fall_angle', math.pi / 3, 'rad', (0.1, 1.5),
         'body pitch beyond which the robot lies on the floor', 'project'),
        ('on_wall_hit', 'stop', '', ('stop', 'report'),
         'what follows a wall hit: the run has failed, or it is reported and goes on', 'B.3'),
        ('dead_zone', 0.0, '%', (0.0, 50.0), 'duty that friction swallows', '6.2'),
        ('backlash', 0.0, 'rad', (0.0, 0.5), 'motor gear play, from stop to stop', '2.2'),
        ('voltage_slope', 0.001089, 'V/mV', (0.0, 1.0), 'motor voltage per battery voltage',
         '(6.1)'),
        ('voltage_offset', -0.625, 'V', (-10.0, 10.0), 'motor voltage at no battery voltage',
         '(6.1)'),
        ('battery_model', 'constant', '', ('constant', 'draining'),
         'constant voltage, or one that sags with current and falls with charge', 'project'),
        ('battery_voltage', 8.0, 'V', (1.0, 12.0), 'open-circuit battery voltage at the start',
         '6.2'),
        ('battery_resistance', 0.6, 'Ω', (0.0, 10.0), 'internal resistance, draining model',
         'project'),
        ('battery_capacity', 7200.0, 'C', (1.0, 1e6),
         'charge that takes a fresh battery (9.5 V) to a low one (7 V), draining model',
         'project'),
        ('idle_current', 0.1, 'A', (0.0, 10.0), 'current of the brick, draining model',
         'project'),
        ('push_duration', 0.1, 's', (0.001, 10.0), 'how long a plant/push acts', 'project',
         Acts.AT_ONCE),
        ('real_time_factor', 1.0, '1', _OrZero((0.01, 1000.0)),
         'pace against the wall clock; 0: as fast as it can', 'project', Acts.AT_ONCE),
        ('duration', 0.0, 's', (0.0, 1e6), 'length of the run; 0: until stopped', 'project'),
        ('timeout', 2.0, 's', (0.2, 3600.0), 'silence after which the run has failed', 'project'),
        ('startup_timeout', 30.0, 's', (0.2, 3600.0), 'the same before the first tick',
         'project'),
        ('on_timeout', 'end', '', ('end', 'wait'),
         'what follows a silence: end with an error, or wait for the participant', 'project'),
        ('require_recorder', False, '', None,
         'true: the first tick waits for a recorder, so that nothing is missing', 'project'),
        ('trajectory_file', '', '', None,
         'where to write the true trajectory (.npz) at the end; empty: nowhere', 'project'),
    ),
    *_rows(
        GYRO,
        ('zero_rate_offset_x', 600.0, 'deg/s', (0.0, 1023.0), 'reading at rest, gyro S1 (x)',
         'facts'),
        ('zero_rate_offset_y', 600.0, 'deg/s', (0.0, 1023.0), 'reading at rest, gyro S2 (y)',
         'facts'),
        ('noise', 0.0, 'deg/s', (0.0, 100.0), 'standard deviation of the noise', '2.2'),
        ('drift', 0.0, 'deg/s', (0.0, 50.0), 'amplitude of the slow drift of the offset', '2.2'),
        ('drift_period', 300.0, 's', (1.0, 1e6), 'period of the drift', '2.2'),
        ('rate_limit', 360.0, 'deg/s', (1.0, 1e4), 'largest rate that the gyro measures',
         'facts'),
    ),
    *_rows(
        SONAR,
        ('noise_cm', 0.0, 'cm', (0.0, 50.0), 'largest error of an echo', 'facts'),
        ('dropout_probability', 0.0, '1', (0.0, 1.0), 'share of echoes that are missed (255)',
         'facts'),
        ('max_range_cm', 255.0, 'cm', (1.0, 255.0), 'distance from which no echo returns',
         'facts'),
        ('min_range_cm', 0.0, 'cm', (0.0, 255.0),
         'distance below which half of the echoes are missed', 'facts'),
        ('distance_model', 'exact', '', ('exact', 'stepped'),
         'distance along a ray: exactly, or in steps of 1 cm', 'B.3'),
        ('cone_angle', 0.0, 'rad', (0.0, 3.0), 'opening of the sound cone; 0: a single ray',
         'project'),
        ('cone_rays', 7, '1', (1, 99), 'rays of the cone, an odd number; the nearest echo counts',
         'project'),
    ),
    *_rows(
        CONTROLLER,
        ('implementation', 'python', '', ('python', 'c', 'arm'),
         'what computes: the Python program, the C generated from it, or that on an emulated ARM',
         'project'),
        ('mode', 'remote', '', ('remote', 'autonomous'), 'drive mode (task_init)', '7.3'),
        ('k_f', (-0.01504899, -1.56981134, -0.02700482, -0.23249821), 'V/deg, V·s/deg', _ANY,
         'servo control feedback gain of θ, ψ, θ˙, ψ˙', '4.2'),
        ('k_i', -0.00712528, 'V/(deg·s)', _ANY, 'servo control integral gain', '4.2'),
        ('a_b', 0.8, '1', _COEFFICIENT, 'low pass: battery voltage', '7.7'),
        ('a_d', 0.8, '1', _COEFFICIENT, 'low pass: velocity', '7.7'),
        ('a_r', 0.996, '1', _COEFFICIENT, 'low pass: speed reference', '7.7'),
        ('a_gc', 0.8, '1', _COEFFICIENT, 'low pass: gyro calibration', '7.7'),
        ('a_gd', 0.999, '1', _COEFFICIENT, 'low pass: gyro drift', '7.7'),
        ('pwm_gain', 1.0, '1', (0.0, 100.0), 'friction compensator gain', '7.7'),
        ('pwm_offset', 0.0, '%', (0.0, 100.0), 'friction compensator offset', '7.7'),
        ('dst_thr', 30, 'cm', (-1, 255), 'obstacle avoidance threshold', '7.7'),
        ('sonar_hold', 0, 'ms', (0, 60_000), 'how long the last echo counts when none returns',
         'project'),
        ('time_start', 1000, 'ms', _UINT32, 'gyro calibration time', '7.4'),
        ('time_auto', 5000, 'ms', _UINT32, 'start of autonomous drive', '7.6'),
        ('time_stop', 500, 'ms', _UINT32, 'time out of control until the motors stop', '7.6'),
        ('theta_diff_thr', 600.0, 'deg', (0.0, 1e6), 'wheel angle error out of control', '7.6'),
        ('psi_diff_thr', 15.0, 'deg', (0.0, 180.0), 'body pitch error out of control', '7.6'),
        ('sound_freq', 440, 'Hz', (31, 14080), 'tone after calibration', '7.6'),
        ('sound_dur', 500, 'ms', (0, 65535), 'length of that tone', '7.6'),
        ('sound_volume', 70, '%', (0, 100), 'volume of that tone', '7.6'),
        ('tone_gain', 0, 'Hz/cm', (0, 55), 'tone in proportion to the distance; 0: none', '10'),
        ('log_count', 25, 'ticks', (1, 255), 'ticks from one log packet to the next', '7.4'),
        ('ts2_period', 20, 'ms', _PERIODS, 'period of task_ts2: obstacles', '7.5'),
        ('ts3_period', 100, 'ms', _PERIODS,
         'period of task_ts3: operating state, battery, sound', '7.6'),
        ('lsb', 2.0**-10, 'deg', (1e-9, 1e3), 'value of one bit of the logged pitch', '7.4'),
        ('rejoin', False, '', None,
         'true: a controller started in mid-run begins afresh; false: it fails the run at once',
         'project'),
    ),
    *_rows(
        GAMEPAD,
        ('device', 'any', '', None,
         'gamepad to read directly: any, its number, or part of its name; empty: none', 'project'),
        ('keyboard', False, '', None, 'true: the arrow keys of the terminal drive', 'project'),
        ('log_csv', '', '', None,
         'file for the data log as CSV, a further one for each reset; empty: none', 'facts'),
        ('require_enable_button', False, '', None,
         'joy and gamepad: true: the sticks count while the enable button is pressed', 'project'),
        ('enable_button', 9, '1', (0, 63), 'that button; 9 is the left shoulder', 'project'),
        ('enable_turbo_button', -1, '1', (-1, 63),
         'button for the turbo scales, which enables, too; -1: none', 'project'),
        ('deadzone', 0.05, '1', (0.0, 0.95), 'share of an axis around its middle that is neutral',
         'project'),
        ('axis_forward', 1, '1', (-1, 63), 'axis that drives forward; -1: none', 'project'),
        ('axis_rightward', 2, '1', (-1, 63), 'axis that drives rightward; -1: none', 'project'),
        ('scale_forward', 1.0, '1', _COEFFICIENT, 'share of the full stick at a full axis',
         'project'),
        ('scale_rightward', 1.0, '1', _COEFFICIENT, 'share of the full stick at a full axis',
         'project'),
        ('scale_forward_turbo', 1.0, '1', _COEFFICIENT, 'the same with the turbo button',
         'project'),
        ('scale_rightward_turbo', 1.0, '1', _COEFFICIENT, 'the same with the turbo button',
         'project'),
        ('invert_forward', False, '', None, 'true: the other end of the axis is forward',
         'project'),
        ('invert_rightward', False, '', None, 'true: the other end of the axis is rightward',
         'project'),
    ),
    *_rows(
        RECORDER,
        ('output', '', '', None, 'file to write; empty: a new one under runs/', 'project',
         Acts.NEVER),
        ('attachments', '', '', None,
         'folder whose files are attached to the recording; empty: none', 'project', Acts.NEVER),
    ),
    *_rows(
        PLAYER,
        ('file', '', '', None, 'recording to play', 'project', Acts.NEVER),
        ('rate', 1.0, '1', (0.01, 100.0), 'speed in times real time', 'project', Acts.AT_ONCE),
        ('start', 0.0, 's', (0.0, 1e9), 'where to begin, after the first message', 'project',
         Acts.NEVER),
        ('loop', False, '', None, 'true: begins again at the end', 'project', Acts.NEVER),
        ('topics', '', '', None, 'topics to play, with commas between; empty: all', 'project',
         Acts.NEVER),
    ),
    *_rows(
        VIEWER,
        ('host', '127.0.0.1', '', None,
         'address that serves the page: all who reach it can look, those with the token can steer',
         'project', Acts.NEVER),
        ('port', 8080, '1', (0, 65535), 'its port; 0: a free one', 'project', Acts.NEVER),
    ),
    *_rows(
        VISUALIZER,
        ('rate', 30.0, 'Hz', (1.0, 250.0), 'markers and transforms a second, at most', 'project',
         Acts.NEVER),
    ),
    *_rows(
        SUPERVISOR,
        ('scenario', '', '', None,
         'scenario (name or file) of the run that supervisor/start begins', 'project',
         Acts.AT_ONCE),
    ),
)  # fmt: skip

PATHS = frozenset(
    {'map', 'scenario', 'trajectory_file', 'log_csv', 'output', 'attachments', 'file'}
)
"""Parameters that name, or may name, a file or folder."""

AGREED = tuple(
    row.name for row in TABLE if len(set(row.nodes) & set(NODES)) > 1 and row.name != 'scenario'
)
"""Parameters that the participants of a run have to agree on. A scenario may be given to the plant
for its pushes, or to the gamepad for its sticks, alone."""

_BY_NODE: dict[str, dict[str, Parameter]] = {
    node: {row.name: row for row in TABLE if node in row.nodes} for node in ALL_NODES
}


def parameters_of(node: str) -> Mapping[str, Parameter]:
    """Return the rows that `node` declares, by name."""
    return _BY_NODE[node]


class ParameterSet:
    """A value for every parameter of every node; unset ones have the table's default."""

    def __init__(self) -> None:
        self._values: dict[tuple[str, str], Value] = {}

    def __iter__(self) -> Iterator[tuple[str, str, Value]]:
        """Yield node, name and value of everything that was set."""
        for (node, name), value in self._values.items():
            yield node, name, value

    def set(self, node: str, name: str, value: Any, where: str = '') -> None:
        """Set `name` of `node`, or of every node that has it where `node` is ``'/**'``.

        Raises
        ------
        ParameterError
            If the node or the parameter is unknown, or the value is not allowed; `where` (a
            file and line) begins the message.
        """
        prefix = f'{where}: ' if where else ''
        if node == '/**':
            nodes = [known for known in ALL_NODES if name in _BY_NODE[known]]
            if not nodes:
                raise ParameterError(f'{prefix}no node has a parameter {name!r}')
        elif node in ALL_NODES:
            nodes = [node]
        else:
            raise ParameterError(f'{prefix}unknown node {node!r}; known: {", ".join(ALL_NODES)}')
        for each in nodes:
            row = _BY_NODE[each].get(name)
            if row is None:
                raise ParameterError(
                    f'{prefix}{each} has no parameter {name!r}; {nearest(name, each)}'
                )
            checked = row.check(value, f'{prefix}{each}.')
            # A shared parameter is one value: its nodes must never disagree.
            for sharer in row.nodes:
                self._values[sharer, name] = checked

    def is_set(self, node: str, name: str) -> bool:
        """Tell whether a parameter was set, rather than left at its default."""
        return (node, name) in self._values

    def update(self, other: ParameterSet) -> None:
        """Take over everything that was set in `other`."""
        self._values.update(other._values)

    def values(self, node: str) -> dict[str, Any]:
        """Return every parameter of `node` by name."""
        return {
            name: self._values.get((node, name), row.default)
            for name, row in _BY_NODE[node].items()
        }


def nearest(name: str, node: str) -> str:
    """Return a hint at what `name` may have meant, or what `node` has."""
    known = sorted(_BY_NODE[node])
    close = get_close_matches(name, known)
    if close:
        return f'did you mean {" or ".join(close)}?'
    return f'it has {", ".join(known) or "none"}'


_Settings = TypeVar('_Settings')


def select(cls: type[_Settings], values: Mapping[str, Any]) -> _Settings:
    """Build the dataclass `cls` from the parameters in `values` that its fields name."""
    return cls(**{field.name: values[field.name] for field in fields(cls)})  # type: ignore[arg-type]
