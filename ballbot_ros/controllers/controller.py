"""Controllers that replace the document's program; studies compile laws on numbers."""

from __future__ import annotations

import math
import operator
from collections import namedtuple
from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import dataclass, fields, replace
from functools import cache
from typing import Any, ClassVar, Generic, NamedTuple, TypeVar, get_args, get_origin

import numpy as np

from ballbot_ros.controllers.interface import Estimates, OperatingState
from ballbot_ros.errors import ControllerError, short_repr
from ballbot_ros.parameters import ControllerParameters, PlantParameters
from ballbot_ros.parameters.timing import TICK_MS
from ballbot_ros.robot.brick.brick import NO_SAMPLE, Brick, Inputs
from ballbot_ros.robot.brick.schedule import TaskTiming
from ballbot_ros.robot.brick.sensors import NO_DATA_CM, NO_ECHO_CM
from ballbot_ros.robot.plant.model import PhysicalParameters

TICK = 'tick'
"""Name of the task of a controller that has only one."""

IDLE = 'idle'
"""Name of the task that makes the ticks if no task of the controller has the shortest period."""

MAX_TASKS = 8

MAX_DUTY = 100
"""Largest duty [%]."""

VOLTAGE_SLOPE, VOLTAGE_OFFSET = PlantParameters.voltage_slope, PlantParameters.voltage_offset


@dataclass(frozen=True)
class NoParameters:
    """The parameters of a controller that has none."""


P = TypeVar('P')
"""Class of a controller's parameters: a frozen dataclass."""

Method = TypeVar('Method', bound=Callable[..., Any])
"""A method of a controller."""

Duty = tuple[int, int]
"""Duty of the motors B (plane x) and C (plane y) [%], whole numbers in -100 ... 100."""


class Readings(NamedTuple):
    """What the brick's devices report at a tick.

    Attributes
    ----------
    elapsed_ms : int
        Time since the start of the run [ms]. The robot is held still for the first second.
    gyro : tuple of int
        Rates of the planes x and y [deg/s], plus the offset of each gyro, about 600.
    revolutions : tuple of int
        Angles of the motors B (plane x) and C (plane y) against the body [deg].
    battery_mv : int
        Battery voltage [mV], a new sample every 20 ms.
    distance_cm : int
        Distance to an obstacle [cm], 255 for none; a new sample every 20 ms.
    sticks : tuple of int
        Left vertical (up is negative) and right horizontal of the newest packet, -100 ... 100.
    """

    elapsed_ms: int
    gyro: tuple[int, int]
    revolutions: tuple[int, int]
    battery_mv: int
    distance_cm: int = NO_ECHO_CM
    sticks: tuple[int, int] = (0, 0)

    def __str__(self) -> str:
        return (
            f'gyro {self.gyro}, revolutions {self.revolutions}, battery {self.battery_mv} mV, '
            f'distance {self.distance_cm} cm, sticks {self.sticks}'
        )

    @property
    def max_voltage(self) -> float:
        """Voltage of a motor at a duty of 100 % [V] (6.1)."""
        return max_voltage(self.battery_mv)

    def duty(self, voltage: float) -> int:
        """Return the duty [%] nearest to a motor voltage [V], as :func:`duty_of_voltage`."""
        return duty_of_voltage(voltage, self.battery_mv)


def max_voltage(battery_mv: int) -> float:
    """Return the voltage of a motor at a duty of 100 % [V] (6.1)."""
    return VOLTAGE_SLOPE * battery_mv + VOLTAGE_OFFSET


def duty_of_voltage(voltage: float, battery_mv: int) -> int:
    """Return the duty [%] nearest to a motor voltage [V], at most ±100.

    It is 0 if the battery gives no voltage. It raises ValueError for NaN.
    """
    if math.isnan(voltage):
        raise ValueError('the voltage is NaN')
    full = max_voltage(battery_mv)
    if full <= 0.0:
        return 0
    return round(max(-100.0, min(100.0, MAX_DUTY * voltage / full)))


NO_READINGS = Readings(0, (0, 0), (0, 0), 0)
"""The readings before the first tick."""


def next_readings(before: Readings, elapsed_ms: int, inputs: Inputs) -> Readings:
    """Return the readings of a tick; a device without a new sample keeps its reading."""
    gyro_x, gyro_y, revolution_x, revolution_y, sonar_cm, battery_mv, vertical, horizontal = inputs
    return Readings(
        elapsed_ms,
        (gyro_x, gyro_y),
        (revolution_x, revolution_y),
        before.battery_mv if battery_mv == NO_SAMPLE else battery_mv,
        before.distance_cm if sonar_cm == NO_SAMPLE else known_distance(sonar_cm),
        before.sticks if vertical == NO_SAMPLE else (vertical, horizontal),
    )


def known_distance(sonar_cm: int) -> int:
    """Return the sonar's distance [cm]; that of no echo if the sensor does not answer."""
    return NO_ECHO_CM if sonar_cm == NO_DATA_CM else sonar_cm


class Controller(Generic[P]):
    """A controller: subclass it, and implement :meth:`tick` or methods marked by :func:`task`.

    The class of its parameters is the argument of the base class: ``class PID(Controller[Gains])``.
    It is a frozen dataclass whose fields are declared by
    :func:`~ballbot_ros.parameters.quantity` and similar functions, with units and bounds. Their
    values are set as ``controller.user.<name>``.

    A new instance is made for each run. Without arguments it has the defaults.

    Attributes
    ----------
    portable : bool
        Whether its duties are the same on every machine. Declare False if it computes them by
        LAPACK, a solver or a neural network.
    tunable_settings : tuple of str
        Names of the settings that it takes over when they change during a run, like its own
        parameters that are declared with ``takes_effect=TakesEffect.IMMEDIATELY``.
    parameters : P
        The values for the run; others after :meth:`retune`.
    model : PhysicalParameters
        The physical values to design for, set as ``controller.model.<name>``. Unless they are set,
        they are those of the document; the plant's may differ.
    settings : ControllerParameters
        The parameters that scenarios set for any controller, such as ``mode`` and ``k_thetadot``.
    x, y : Estimates
        What it estimates, for ``controller/state``.
    operating_state : OperatingState
        Published on ``operating_state`` when it changes.
    """

    portable: ClassVar[bool] = True
    tunable_settings: ClassVar[tuple[str, ...]] = ()
    parameters_class: ClassVar[type] = NoParameters

    def __init_subclass__(cls, **arguments: Any) -> None:
        super().__init_subclass__(**arguments)
        for base in cls.__dict__.get('__orig_bases__', ()):
            origin = get_origin(base)
            if isinstance(origin, type) and issubclass(origin, Controller):
                (parameters,) = get_args(base)
                if isinstance(parameters, type):
                    cls.parameters_class = parameters
                elif not isinstance(parameters, TypeVar):
                    raise TypeError(f'{origin.__name__}[{parameters}]: it is not a class')

    def __init__(
        self,
        parameters: P | None = None,
        model: PhysicalParameters | None = None,
        settings: ControllerParameters | None = None,
    ) -> None:
        self.model = model or PhysicalParameters.from_parameters(PlantParameters())
        given: P = self.parameters_class() if parameters is None else parameters
        self.parameters = with_design(type(self), given, self.model)
        self.settings = settings or ControllerParameters()
        self.x, self.y = Estimates(), Estimates()
        self.operating_state = OperatingState.BALANCE
        self._brick = Brick()
        self.start()

    @classmethod
    def design(cls, parameters: P, model: PhysicalParameters) -> P:
        """Return the parameters with values for those declared by ``designed``.

        It is called once, when a run is composed; the values become parameters of the run.
        """
        return parameters

    def start(self) -> None:
        """Set the initial state, before the first tick of a run."""

    def retune(self, parameters: P, settings: ControllerParameters) -> None:
        """Take over values that change during the run; called before a tick.

        Real numbers glide to a new value within 0.5 s, and this is called at each tick meanwhile.
        Override it if something is computed from them, and call this first.
        """
        self.parameters, self.settings = parameters, settings

    def tick(self, readings: Readings) -> Duty:
        """Return the duty of the motors for the readings of a tick; called every 4 ms."""
        raise NotImplementedError

    def sound(self, frequency_hz: int, duration_ms: int, volume: int) -> None:
        """Sound a tone: 31 ... 14080 Hz, 0 ... 65535 ms, 0 ... 100 %; else ControllerError."""
        self._brick.sound_tone(
            whole_number(frequency_hz, 31, 14080, 'frequency_hz'),
            whole_number(duration_ms, 0, 65535, 'duration_ms'),
            whole_number(volume, 0, 100, 'volume'),
        )

    def log(
        self,
        data1: int = 0,
        data2: int = 0,
        adc1: int = 0,
        adc2: int = 0,
        adc3: int = 0,
        adc4: int = 0,
    ) -> None:
        """Send a record of the data logger: two 8-bit and four 16-bit values, or ControllerError.

        The brick adds time, battery voltage, motor angles and distance.
        """
        self._brick.log(
            whole_number(data1, -128, 127, 'data1'),
            whole_number(data2, -128, 127, 'data2'),
            *(
                whole_number(value, -32768, 32767, f'adc{number}')
                for number, value in enumerate((adc1, adc2, adc3, adc4), 1)
            ),
        )

    def show(self, name: str) -> None:
        """Refresh the display, whose first line is `name`; ControllerError if it is no text."""
        if not isinstance(name, str) or not name.isprintable():
            raise ControllerError(f'name: {short_repr(name)} is not a printable text')
        self._brick.show_status(name)


def with_design(cls: type[Controller[P]], parameters: P, model: PhysicalParameters) -> P:
    """Return the parameters with a design for those that are not set, as flat tuples."""
    missing = [
        each.name
        for each in fields(parameters)  # type: ignore[arg-type]
        if each.metadata.get('is_designed') and not getattr(parameters, each.name)
    ]
    if not missing:
        return parameters
    designed = cls.design(parameters, model)
    flat = {name: _flat(getattr(designed, name), name) for name in missing}
    return replace(parameters, **flat)  # type: ignore[type-var]


def _flat(values: Any, name: str) -> tuple[float, ...]:
    """Return real numbers of any shape as a flat tuple; TypeError if they are something else."""
    array = np.asarray(values)
    if array.dtype.kind not in 'iuf' or not np.isfinite(array).all():
        raise TypeError(f'{name}: {short_repr(values)} are not real, finite numbers')
    return tuple(array.ravel().astype(float).tolist())


def whole_number(value: Any, low: int, high: int, name: str = '') -> int:
    """Return a whole number within bounds as an int; ControllerError if it is none.

    Integers of numpy count; a bool does not, nor does a float without a fraction.
    """
    with suppress(TypeError):
        number = operator.index(value)
        if low <= number <= high and not isinstance(value, bool):
            return number
    prefix = f'{name}: ' if name else ''
    raise ControllerError(f'{prefix}{short_repr(value)} is not a whole number in {low} … {high}')


def task(period_ms: int, priority: int) -> Callable[[Method], Method]:
    """Mark a method of a controller as a task of the brick.

    The method takes the :class:`Readings`. It returns the new duty, or None to keep the present
    one.

    Parameters
    ----------
    period_ms : int
        A multiple of 4 ms.
    priority : int
        Tasks due at the same tick run in the order of their priorities, the highest first.
    """

    def mark(method: Method) -> Method:
        method.timing = TaskTiming(method.__name__, priority, period_ms)  # type: ignore[attr-defined]
        return method

    return mark


def tasks_of(cls: type[Controller[Any]]) -> tuple[TaskTiming, ...]:
    """Return the tasks of a controller, by falling priority.

    It raises ControllerError if there are none, or they are not valid.
    """
    found = [
        method.timing
        for name in dir(cls)
        if isinstance(getattr(method := getattr(cls, name), 'timing', None), TaskTiming)
    ]
    has_tick = cls.tick is not Controller.tick
    if has_tick == bool(found):
        problem = (
            'both tick and tasks; it needs one of them'
            if has_tick
            else 'neither a method tick nor one marked by @task (mark an overriding one again)'
        )
        raise ControllerError(f'{cls.__name__} has {problem}')
    if has_tick:
        return (TaskTiming(TICK, 1, TICK_MS),)
    for each in found:
        if not isinstance(each.period_ms, int) or each.period_ms <= 0 or each.period_ms % TICK_MS:
            raise ControllerError(
                f'{cls.__name__}.{each.name}: the period {each.period_ms!r} ms is not a multiple '
                f'of {TICK_MS} ms'
            )
        if not isinstance(each.priority, int):
            raise ControllerError(
                f'{cls.__name__}.{each.name}: the priority {each.priority!r} is not a whole number'
            )
    if len({each.priority for each in found}) < len(found):
        raise ControllerError(f'{cls.__name__}: two tasks have the same priority')
    if len(found) > MAX_TASKS:
        raise ControllerError(f'{cls.__name__} has {len(found)} tasks; the brick has {MAX_TASKS}')
    if IDLE in {each.name for each in found}:
        raise ControllerError(f'{cls.__name__}: a task must have another name than {IDLE!r}')
    if all(each.period_ms != TICK_MS for each in found):
        found.append(TaskTiming(IDLE, min(each.priority for each in found) - 1, TICK_MS))
    return tuple(sorted(found, key=lambda each: -each.priority))


def every_tick(tasks: Iterable[TaskTiming]) -> str:
    """Return the name of the first task with the shortest period, which runs at every tick."""
    return next(each.name for each in tasks if each.period_ms == TICK_MS)


Law = Callable[[Any, Any, Readings], tuple[Any, Duty]]
"""Returns the next state and the duty for constants, a state, and the readings of a tick."""


class LawController(Controller[P]):
    """A controller whose law is a function on numbers: subclass it, and set `law`.

    The same function runs here and, compiled, in studies: then several hundred times as fast, with
    the same duties. It calls only functions of numbers, of its own module and of this package, and
    those of ``math``.

    Attributes
    ----------
    law : callable
        ``law(constants, state, readings) -> (state, duty)``. It must not depend on anything else.
    state, in_force : named tuple
        The state after the newest tick, and the constants.
    """

    law: ClassVar[Law]

    @classmethod
    def initial_state(cls, constants: Any) -> Any:
        """Return the state before the first tick as a named tuple.

        It has numbers, switches, tuples and named tuples of them; the law returns the same types.
        """
        raise NotImplementedError

    @classmethod
    def constants(cls, parameters: P, model: PhysicalParameters, _: ControllerParameters) -> Any:
        """Return the constants of the law as a named tuple; by default the own parameters.

        The arguments are the attributes `parameters`, `model` and `settings` of
        :class:`Controller`.
        """
        return as_numbers(parameters)

    def start(self) -> None:
        """Set the initial state."""
        self._set_constants()
        self.state = self.initial_state(self.in_force)

    def retune(self, parameters: P, settings: ControllerParameters) -> None:
        """Take over values that change during the run."""
        super().retune(parameters, settings)
        self._set_constants()

    def _set_constants(self) -> None:
        self.in_force = self.constants(self.parameters, self.model, self.settings)

    def tick(self, readings: Readings) -> Duty:
        """Return the duty for the readings of a tick."""
        before = self.state
        self.state, duty = type(self).law(self.in_force, before, readings)
        self.report(before, readings)
        return duty

    def report(self, before: Any, readings: Readings) -> None:
        """Publish what the state tells: estimates, operating state, tones, log; nothing by default.

        It is called after each tick of a run, but not in studies, so no duty may depend on it. The
        state `before` the tick is given; the one after it is `self.state`.
        """


def as_numbers(parameters: Any) -> Any:
    """Return a dataclass as a named tuple of its numbers and switches, without its texts."""
    values = {
        each.name: value
        for each in fields(parameters)
        if not isinstance(value := getattr(parameters, each.name), str)
    }
    return _numbers_class(type(parameters).__name__, tuple(values))(**values)


@cache
def _numbers_class(name: str, members: tuple[str, ...]) -> Any:
    return namedtuple(name, members)
