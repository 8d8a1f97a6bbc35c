"""The devices: their readings as functions on numbers, and the table of all of them.

A reading is that of the present state, or of an earlier step if the samples have a dead time.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, lru_cache
from types import SimpleNamespace
from typing import (
    Any,
    Generic,
    Literal,
    NamedTuple,
    TypeAlias,
    TypeVar,
    get_args,
    get_origin,
    get_type_hints,
)

import numpy as np

from ballbot_ros.parameters import (
    DeviceParameters,
    EncoderParameters,
    GyroParameters,
    NodeParameters,
    SonarParameters,
)
from ballbot_ros.parameters.timing import FIRST_TICK_NS, SLOW_PERIOD_NS, STEP_NS, TICK_NS
from ballbot_ros.robot.arithmetic import Reals
from ballbot_ros.robot.brick import fault_effects as components
from ballbot_ros.robot.brick.fault_effects import active_amount, after_faults, fault_row
from ballbot_ros.robot.brick.faults import faults_of, late_steps
from ballbot_ros.robot.brick.job_times import JobTimes, whole_time
from ballbot_ros.robot.brick.link import NO_LINK, Link, analog_age, link_of, longest_analog_steps
from ballbot_ros.robot.brick.sensors import (
    NO_ECHO_CM,
    drawn_delay,
    encoder_reading,
    gyro_reading,
    quantise,
)
from ballbot_ros.robot.brick.sensors import GyroConstants as PlaneGyro
from ballbot_ros.robot.compiler_hints import compiled_as
from ballbot_ros.robot.plant.ground_truth import GroundTruth, MeasuredState, Pair, state_before
from ballbot_ros.robot.random_numbers import (
    Key,
    device_number,
    noise_bits,
    noise_key,
    normal,
    uniform,
)
from ballbot_ros.robot.world.floor_map import CELL_M, map_point
from ballbot_ros.robot.world.sonar_beam import nearest_echo, sides_of
from ballbot_ros.robot.world.world import Cells


@cache
def choice(cls: type, name: str, value: str) -> int:
    """Return the number that stands for a value of a choice of a dataclass."""
    return get_args(get_type_hints(cls)[name]).index(value)


@cache
def _choices(cls: type) -> dict[str, tuple[object, ...]]:
    words = {
        name: get_args(kind)
        for name, kind in get_type_hints(cls).items()
        if get_origin(kind) is Literal
    }
    return {name: each for name, each in words.items() if isinstance(each[0], str)}


def numbers_of(parameters: NodeParameters) -> SimpleNamespace:
    """Return the parameters of a node by their names, choices as in :func:`choice`."""
    values = SimpleNamespace(**parameters.values())
    cls: Any = type(parameters)
    for name, words in _choices(cls).items():
        setattr(values, name, words.index(getattr(values, name)))
    return values


_BLOCK = 256
_KEPT_BLOCKS = 128
_WORD = 0xFFFFFFFF
_HALF = 32

Numbers = tuple[float, float]


def one_uniform_pair(key: Key, device: np.uint64, index: int) -> Numbers:
    """Return what :func:`uniform_pair` does, without a block."""
    one, other = _bits(key, device, index)
    return uniform(one), uniform(other)


def one_normal_pair(key: Key, device: np.uint64, index: int) -> Numbers:
    """Return what :func:`normal_pair` does, without a block."""
    one, other = _bits(key, device, index)
    return normal(one), normal(other)


@compiled_as(one_uniform_pair)
def uniform_pair(key: Key, device: np.uint64, index: int) -> Numbers:
    """Return the two uniform numbers of sample `index` of a device, within [0, 1)."""
    return _block(uniform, key, device, index // _BLOCK)[index % _BLOCK]


@compiled_as(one_normal_pair)
def normal_pair(key: Key, device: np.uint64, index: int) -> Numbers:
    """Return the two standard normal numbers of sample `index` of a device."""
    return _block(normal, key, device, index // _BLOCK)[index % _BLOCK]


def _bits(key: Key, device: np.uint64, index: int) -> tuple[Any, Any]:
    low, high = noise_bits(np.uint64(index & _WORD), np.uint64(index >> _HALF), device, key)
    return np.int64(low), np.int64(high)


@lru_cache(_KEPT_BLOCKS)
def _block(
    number: Callable[[int], float], key: Key, device: np.uint64, block: int
) -> list[Numbers]:
    first = block * _BLOCK
    low = np.arange(first & _WORD, (first & _WORD) + _BLOCK, dtype=np.uint64)
    pairs = noise_bits(low, np.uint64(first >> _HALF), device, key)
    one, other = (map(number, bits.tolist()) for bits in pairs)
    return list(zip(one, other, strict=True))


GYRO, GYRO_DRIFT, SONAR = (device_number(name) for name in ('gyro', 'gyro drift', 'sonar'))


def delay_number(device: str) -> np.uint64:
    """Return what distinguishes the dead times of a device among the random numbers."""
    return device_number(f'{device} delay')


GYRO_DELAY, ENCODER_DELAY, SONAR_DELAY = map(delay_number, ('gyro', 'encoder', 'sonar'))


EXACT = choice(SonarParameters, 'distance_model', 'exact')

NEAR_DROPOUT = 0.5
"""Minimum share of missed echoes from an obstacle closer than the minimum range."""


class GyroConstants(NamedTuple):
    """Both gyros; `noise` is the standard deviation [deg/s], dead times are in steps.

    The link adds to them.
    """

    x: PlaneGyro
    y: PlaneGyro
    noise: float
    delay: int
    jitter: int
    key: Key
    link: Link


class EncoderConstants(NamedTuple):
    """Dead time [steps] of the encoders."""

    delay: int
    jitter: int
    key: Key


class SonarConstants(NamedTuple):
    """The sonar; lengths as their names say, the angle in rad, dead times in steps.

    `noise_cm` is the bound of the error, `dropout` the share of missed echoes.
    """

    to_front_m: float
    cone_angle: float
    rays: int
    is_exact: bool
    noise_cm: float
    dropout: float
    min_range_cm: float
    max_range_cm: float
    delay: int
    jitter: int
    key: Key


def gyro_constants(p: Any) -> GyroConstants:
    """Return the constants of the gyros for their parameters."""
    key = noise_key(p.seed)
    phase_x, phase_y = uniform_pair(key, GYRO_DRIFT, 0)
    period_ns = round(p.drift_period * 1e9)
    return GyroConstants(
        (p.zero_rate_offset_x, p.rate_limit, p.noise, p.drift, period_ns, phase_x),
        (p.zero_rate_offset_y, p.rate_limit, p.noise, p.drift, period_ns, phase_y),
        p.noise, p.delay, p.delay_jitter, key, link_of(p),
    )  # fmt: skip


def encoder_constants(p: Any) -> EncoderConstants:
    """Return the constants of the encoders for their parameters."""
    return EncoderConstants(p.delay, p.delay_jitter, noise_key(p.seed))


def sonar_constants(p: Any) -> SonarConstants:
    """Return the constants of the sonar for its parameters."""
    return SonarConstants(
        p.body_depth / 2.0, p.cone_angle, p.cone_rays if p.cone_angle else 1,
        p.distance_model == EXACT, p.noise_cm, p.dropout_probability,
        p.min_range_cm, p.max_range_cm, p.delay, p.delay_jitter, noise_key(p.seed),
    )  # fmt: skip


JOB = device_number('job')


def varied(times: JobTimes, time_us: float, key: Key, task: int, now_ns: int) -> int:
    """Return the time of a job that begins in a tick [µs], with its random variation."""
    chance = 0.0
    if times.variation:
        chance, _ = uniform_pair(key, JOB + np.uint64(task), now_ns // TICK_NS)
    return whole_time(times, time_us, chance)


def read_gyro(
    constants: GyroConstants, rate_x: float, rate_y: float, stamp_ns: int
) -> tuple[int, int]:
    """Return the readings of both gyros [deg/s + offset] for pitch rates [rad/s]."""
    error_x = error_y = 0.0
    if constants.noise:
        error_x, error_y = normal_pair(constants.key, GYRO, stamp_ns // TICK_NS)
    return (
        gyro_reading(constants.x, rate_x, error_x, stamp_ns),
        gyro_reading(constants.y, rate_y, error_y, stamp_ns),
    )


def read_encoder(angle_x: float, angle_y: float) -> tuple[int, int]:
    """Return the counts [deg] for the angles of the motor shafts [rad]."""
    return encoder_reading(angle_x), encoder_reading(angle_y)


def read_sonar(constants: SonarConstants, x: float, y: float, sides: Cells, stamp_ns: int) -> int:
    """Return the reading [cm] for a position of the ball [m]; 255 for no echo.

    `sides` is as in :func:`distance_ahead`.
    """
    return echo(constants, distance_ahead(constants, x, y, sides), stamp_ns)


def distance_ahead(constants: SonarConstants, x: float, y: float, sides: Cells) -> float:
    """Return the distance [m] from the sensor to the nearest wall, inf if there is none.

    The ball's centre is at x, y [m]. `sides` is the result of
    :func:`~ballbot_ros.robot.world.sonar_beam.sides_of`.
    """
    if not len(sides):
        return math.inf
    rows, columns = sides.shape
    sensor = map_point(columns, rows, (x + constants.to_front_m, y))
    return CELL_M * nearest_echo(
        sides, sensor, constants.cone_angle, constants.rays, constants.is_exact
    )


def echo(constants: SonarConstants, distance_m: float, stamp_ns: int) -> int:
    """Return the reading [cm] for the distance [m] to an obstacle; 255 for no echo."""
    chance, error = uniform_pair(constants.key, SONAR, stamp_ns // SLOW_PERIOD_NS)
    distance, dropout = distance_m * 100.0, constants.dropout
    if distance < constants.min_range_cm:
        dropout = max(dropout, NEAR_DROPOUT)
    if distance >= constants.max_range_cm or chance < dropout:
        return NO_ECHO_CM
    reading = quantise(distance + constants.noise_cm * (2.0 * error - 1.0))
    return max(0, min(NO_ECHO_CM, reading))


def sample_age(
    delay: int, jitter: int, key: Key, device: np.uint64, period_ns: int, stamp_ns: int
) -> int:
    """Return the age [steps] of a sample: that of the newest measurement which has arrived by then.

    So a sample never measures an earlier instant than the sample before it.
    """
    if not jitter:
        return delay
    index, period = stamp_ns // period_ns, period_ns // STEP_NS
    age = delay + jitter
    # One that is earlier by more than the jitter has in any case measured an earlier instant.
    for earlier in range(jitter // period + 1):
        chance, _ = uniform_pair(key, device, index - earlier)
        age = min(age, drawn_delay(delay, jitter, chance) + earlier * period)
    return age


P = TypeVar('P', bound=DeviceParameters)
"""Parameters of a device's driver."""

Reading = TypeVar('Reading')
"""The reading, in the brick's integers."""

Read: TypeAlias = Callable[[Pair, int], Reading]
"""Returns the reading of a measured quantity, in SI, at a stamp [ns]."""


@dataclass(frozen=True)
class Device(Generic[P, Reading]):
    """A device of the brick.

    Attributes
    ----------
    field : str
        Field of :class:`~ballbot_ros.robot.brick.brick.DeviceInputs` that holds its readings.
    components : tuple of int
        Whose faults concern the measured quantity of planes x and y.
    measured : callable
        Returns the measured quantity of a true state, the present one or that of an earlier step.
    link_of : callable
        Returns the link that the samples pass.
    make : callable
        Creates a device from its parameters and returns its read function. A reading depends only
        on the measured quantity and the stamp, never on earlier readings. Raises BallbotError if
        the parameters contradict each other.
    """

    parameters: type[P]
    field: str
    components: tuple[int, int]
    measured: Callable[[GroundTruth | MeasuredState], Pair]
    make: Callable[[P], Read[Reading]]
    link_of: Callable[[P], Link] = lambda parameters: NO_LINK

    @property
    def period_ns(self) -> int:
        """Sampling period in sim time [ns]."""
        return self.parameters.period_ns

    def reader(self, parameters: P, faults: Reals) -> Read[Any]:
        """Return the function of `make`, with the row of faults, which may change later."""
        read, key, period_ns = self.make(parameters), noise_key(parameters.seed), self.period_ns

        def faulty(measured: Pair, stamp_ns: int) -> Any:
            reading: Any = read(measured, stamp_ns)
            values = (reading,) if isinstance(reading, int) else reading
            left = tuple(
                after_faults(faults, component, value, stamp_ns, period_ns, key)
                for component, value in zip(self.components, values, strict=False)
            )
            return left[0] if isinstance(reading, int) else left

        return faulty

    def age_of(
        self, parameters: P, start_ns: int = FIRST_TICK_NS
    ) -> Callable[[int], tuple[tuple[int, int], float]]:
        """Return the function that gives the ages of the sample with a stamp [ns].

        They are those of the older one of two steps [steps], for planes x and y, and the share of
        the later one. `start_ns` is the start of the run.
        """
        faults = fault_row(faults_of(parameters), start_ns)
        delay, jitter, key = parameters.delay, parameters.delay_jitter, noise_key(parameters.seed)
        number = delay_number(self.parameters.node.removesuffix('_driver'))
        link = self.link_of(parameters)

        def age(stamp_ns: int) -> tuple[tuple[int, int], float]:
            age = sample_age(delay, jitter, key, number, self.period_ns, stamp_ns)
            older, share = analog_steps(link, stamp_ns)
            x, y = (
                age + older + int(active_amount(faults, each, components.DELAYED, stamp_ns))
                for each in self.components
            )
            return (x, y), share

        return age

    def measured_of(self, steps: tuple[float, ...], ages: tuple[int, int], share: float) -> Pair:
        """Return the quantity at ages as in :meth:`age_of`, of steps as in `GroundTruth`."""
        x, y = self._measured_at(steps, ages[0], share)
        return (x, y) if ages[0] == ages[1] else (x, self._measured_at(steps, ages[1], share)[1])

    def _measured_at(self, steps: tuple[float, ...], age: int, share: float) -> Pair:
        x, y = self.measured(state_before(steps, age))
        if share:
            later_x, later_y = self.measured(state_before(steps, age - 1))
            x, y = between(x, later_x, share), between(y, later_y, share)
        return x, y

    def longest_delay(self, parameters: P) -> int:
        """Return the longest dead time of the samples [steps]."""
        link = self.link_of(parameters)
        longest = longest_analog_steps(link.is_on, link.converter_ns / STEP_NS)
        late = late_steps(faults_of(parameters))
        return parameters.delay + parameters.delay_jitter + longest + late


def analog_steps(link: Link, stamp_ns: int) -> tuple[int, float]:
    """Return how many steps before a stamp an analog value was measured, rounded up, and a share.

    It was measured between that step and the next one, after this share of the time.
    """
    if not link.is_on:
        return 0, 0.0
    age_ns = analog_age(link, stamp_ns)
    older = -(-age_ns // STEP_NS)
    return older, (older * STEP_NS - age_ns) / STEP_NS


def between(earlier: float, later: float, share: float) -> float:
    """Return the value after a share of the time between two values."""
    return earlier + (later - earlier) * share


def _gyro(parameters: GyroParameters) -> Read[tuple[int, int]]:
    constants = gyro_constants(parameters)
    return lambda rates, stamp_ns: read_gyro(constants, rates[0], rates[1], stamp_ns)


def _encoder(parameters: EncoderParameters) -> Read[tuple[int, int]]:
    return lambda angles, stamp_ns: read_encoder(angles[0], angles[1])


def _sonar(parameters: SonarParameters) -> Read[int]:
    constants = sonar_constants(numbers_of(parameters))
    sides = sides_of(parameters)
    return lambda position, stamp_ns: read_sonar(constants, *position, sides, stamp_ns)


GYRO_DEVICE = Device(
    GyroParameters, 'gyro', (components.GYRO_X, components.GYRO_Y),
    lambda truth: truth.psi_rate, _gyro, link_of,
)  # fmt: skip
ENCODER_DEVICE = Device(
    EncoderParameters, 'revolutions', (components.ENCODER_X, components.ENCODER_Y),
    lambda truth: truth.motor_angle, _encoder,
)  # fmt: skip
SONAR_DEVICE = Device(
    SonarParameters, 'sonar_cm', (components.SONAR, components.SONAR),
    lambda truth: truth.position, _sonar,
)  # fmt: skip

AnyDevice: TypeAlias = Device[Any, Any]
"""A device of any kind."""

ALL_DEVICES: tuple[AnyDevice, ...] = (GYRO_DEVICE, ENCODER_DEVICE, SONAR_DEVICE)
