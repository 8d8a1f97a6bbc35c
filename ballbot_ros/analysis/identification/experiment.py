"""What parameters are identified from: the readings of a run, at equal steps.

There is one implementation of each law, on plain floats. Where many trajectories are needed at
once, the same code runs on arrays, element by element.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import Enum, auto
from operator import attrgetter
from pathlib import Path
from types import FunctionType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ballbot_ros.analysis.data_log import last_log
from ballbot_ros.analysis.run_data import RunData
from ballbot_ros.controllers.document.program import mean_delays
from ballbot_ros.errors import IdentificationError
from ballbot_ros.parameters import (
    ControllerParameters,
    DeviceParameters,
    EncoderParameters,
    GyroParameters,
    PlantParameters,
    Value,
)
from ballbot_ros.parameters.timing import STEP_NS, STEPS_PER_TICK, TICK_MS, TICK_NS, TICK_S
from ballbot_ros.recording.messages.recording_files import open_recording
from ballbot_ros.recording.messages.topics import (
    BATTERY_STATE,
    GYRO_IMU,
    JOINT_STATES,
    MOTOR_DUTY,
    PLANT_IMU,
    PLANT_ODOM,
    Topic,
)
from ballbot_ros.robot import arithmetic
from ballbot_ros.robot.arithmetic import Floats
from ballbot_ros.robot.brick.bluetooth import CLOCK_PERIOD_MS, LogPacket
from ballbot_ros.robot.brick.link import analog_age, link_of
from ballbot_ros.robot.brick.sensors import COUNT_V, battery_mv, count_of, mean_delay


def for_arrays(function: Callable[..., Any]) -> Callable[..., Any]:
    """Return a function on numbers as one on arrays, together with the functions that it calls.

    It must not branch on its arguments other than by `min`, `max` and `sine_cosine`, nor assign to
    them in place. The results are those of the function on numbers, bit for bit.
    """
    assert isinstance(function, FunctionType)
    names = set(function.__code__.co_names)
    replaced: dict[str, Any] = {}
    for name, value in function.__globals__.items():
        if name not in names:
            continue
        if value is arithmetic.sine_cosine:
            replaced[name] = arithmetic.sines_cosines
        elif isinstance(value, FunctionType) and value.__module__.startswith('ballbot_ros'):
            replaced[name] = for_arrays(value)
    replaced.update((name, each) for name, each in _BUILTINS.items() if name in names)
    return FunctionType(function.__code__, {**function.__globals__, **replaced}, function.__name__)


_BUILTINS: dict[str, Callable[..., Any]] = {'min': np.minimum, 'max': np.maximum}


ROUNDING_DEVIATION = math.sqrt(1.0 / 12.0)
"""Standard deviation of the rounding to whole numbers, of a signal that moves."""

_LEAST_NOISE = 0.1
_LEAST_COMMON = 0.02
_TERMS = 8


def expected_rounding(values: Floats, noise: float) -> Floats:
    """Return the mean of ``floor(x + e + 0.5) - x`` for each value x, with a normal error e.

    It is the Fourier series of the sawtooth, whose harmonics the noise damps. With a noise of half
    a count or more it is close to zero. Less noise than a tenth counts as a tenth, so that values
    that are known to a tenth only have no sharp edges.
    """
    total = np.zeros_like(values)
    for harmonic in range(1, _TERMS + 1):
        damping = math.exp(-2.0 * (math.pi * harmonic * max(noise, _LEAST_NOISE)) ** 2)
        size = (-1) ** harmonic / (math.pi * harmonic) * damping
        total += size * np.sin(2.0 * math.pi * harmonic * values)
    return total


def common_rounding(spread: float) -> float:
    """Return the standard deviation of the mean rounding of values that are spread normally.

    Values that all round alike have all of it in common; with a spread of half a count, hardly
    anything is left.
    """
    if spread == 0.0:
        return ROUNDING_DEVIATION
    variance = sum(
        math.exp(-4.0 * (math.pi * harmonic * spread) ** 2) / (2.0 * (math.pi * harmonic) ** 2)
        for harmonic in range(1, _TERMS + 1)
    )
    return max(_LEAST_COMMON, math.sqrt(variance))


class ChannelQuantity(Enum):
    """What a channel measures in each plane."""

    PITCH_RATE = auto()
    """[deg/s]"""
    PITCH = auto()
    """[deg]"""
    ESTIMATED_PITCH = auto()
    """The pitch as the controller estimates it [deg]: the integral of the gyro's reading less its
    offset, which is a low pass of the reading. It forgets the true pitch in the time `filter_s`."""
    SHAFT = auto()
    """Angle of the motor shaft [deg]."""
    POSITION = auto()
    """[m]"""


@dataclass(frozen=True)
class Channel:
    """A measured signal of both planes.

    Attributes
    ----------
    quantity : Quantity
        What it measures.
    noise : float
        Standard deviation of its error to begin with, in its unit. That of the truth is what the
        model of a segment leaves.
    is_rounded : bool
        Whether its readings are whole numbers.
    has_offset : bool
        Whether it has an unknown offset, constant for seconds.
    filter_s : float
        Of an estimated pitch, the time constant of the low pass [s].
    """

    name: str
    unit: str
    quantity: ChannelQuantity
    noise: float
    is_rounded: bool = False
    has_offset: bool = False
    filter_s: float = 0.0


GYRO = Channel('gyro', 'deg/s', ChannelQuantity.PITCH_RATE, 0.8, is_rounded=True, has_offset=True)
ENCODER = Channel('encoder', 'deg', ChannelQuantity.SHAFT, 0.3, is_rounded=True)
TRUE_PITCH_RATE = Channel('pitch rate', 'deg/s', ChannelQuantity.PITCH_RATE, 1e-3)
TRUE_PITCH = Channel('pitch', 'deg', ChannelQuantity.PITCH, 1e-4)
TRUE_POSITION = Channel('position', 'm', ChannelQuantity.POSITION, 1e-6)

LOGGED_ENCODER = Channel('encoder', 'deg', ChannelQuantity.SHAFT, 0.3)
"""In whole degrees. Read a few times a second, its rounding is like noise."""

LOGGED_PITCH = Channel(
    'estimated pitch', 'deg', ChannelQuantity.ESTIMATED_PITCH, 0.02, has_offset=True,
    filter_s=TICK_S / (1.0 - ControllerParameters().a_gd),
)  # fmt: skip

TRUE_BATTERY_V = 1e-6
"""Standard deviation of the battery voltage in the plant's topic [V], in single precision."""


@dataclass(frozen=True)
class Experiment:
    """The readings of a run, at equal steps of time.

    Attributes
    ----------
    plant : PlantParameters
        What is known of the robot; the identified parameters replace its values.
    duty : ndarray, shape (n, 2), or None
        Duties [%] from each reading to the next, which are ticks then. None if they are not known:
        then each motor has an unknown voltage from each reading to the next.
    readings : mapping of Channel to ndarray, shape (n, 2)
        NaN where there is none.
    battery : ndarray, shape (n,)
        Battery voltage [V]; NaN where it was not measured.
    battery_count : float
        Resolution of its reading [V]; 0 if it is not rounded.
    usable : ndarray, shape (n,)
        Whether only the motors moved the robot, from this reading to the next.
    ages : mapping of Channel to float or ndarray, shape (n,)
        Dead time of each channel, or of each of its readings [steps].
    battery_age : int
        Dead time of the battery's readings [steps].
    delays_us : ndarray, shape (n,), or None
        Time until each duty leaves the brick [µs]; None for none.
    interval_factor : float
        How much wider the intervals of estimates are, because of what is not known of the duties.
    notes : tuple of str
        What a reader of the result should know.
    recorded : PlantParameters or None
        The parameters of the recorded robot, if they are known.
    steps_per_reading : int
        Number of steps that the plant is simulated with, from each reading to the next.
    step_s : float
        Length of such a step [s].
    """

    name: str
    plant: PlantParameters
    duty: NDArray[Any] | None
    readings: Mapping[Channel, Floats]
    battery: Floats
    battery_count: float
    usable: NDArray[np.bool_]
    ages: Mapping[Channel, Any] = field(default_factory=dict)
    battery_age: int = 0
    delays_us: NDArray[np.int64] | None = None
    interval_factor: float = 1.0
    notes: tuple[str, ...] = ()
    recorded: PlantParameters | None = None
    steps_per_reading: int = STEPS_PER_TICK
    step_s: float = STEP_NS * 1e-9

    @property
    def reading_s(self) -> float:
        """Time from each reading to the next [s]."""
        return self.steps_per_reading * self.step_s

    @property
    def battery_error(self) -> float:
        """Standard deviation of the error of a battery reading [V].

        It is a whole count: the voltage changes slowly, so that readings round in the same way.
        """
        return self.battery_count or TRUE_BATTERY_V

    @property
    def battery_offset(self) -> float:
        """Standard deviation of the error that all battery readings have in common [V]."""
        if not self.battery_count:
            return TRUE_BATTERY_V
        spread = np.nanvar(self.battery / self.battery_count) - ROUNDING_DEVIATION**2
        return self.battery_count * common_rounding(math.sqrt(max(0.0, float(spread))))


_AFTER_PUSH_S = 0.1


def recorded_experiment(
    run: RunData, known: Mapping[str, Value], *, truth: bool = False
) -> Experiment:
    """Return the experiment in a recorded run.

    `known` has values of the plant that replace the recorded ones, by name. With `truth`, the
    plant's topics are used instead of the readings of the brick's devices. It raises
    IdentificationError if the recording lacks a topic, or was not made in lockstep.
    """
    if not run.plant.lockstep:
        raise IdentificationError(
            f'{run.path}: a free-running run does not tell when each duty acted; record one in '
            'lockstep'
        )
    stamps = _tick_stamps(run)
    time = run.series[MOTOR_DUTY].time[0] + np.arange(len(stamps)) * TICK_S
    recorded = run.plant if run.attached.has_parameters else None
    plant = run.plant.with_values(known)
    delay = mean_delay(plant.actuator_delay, plant.actuator_delay_jitter, STEPS_PER_TICK)
    plant = replace(plant, actuator_delay=round(delay), actuator_delay_jitter=0)
    notes = []
    duty, delays = np.split(_values(run, MOTOR_DUTY, stamps), [2], axis=1)
    battery = _values(run, BATTERY_STATE, stamps)[:, 0]
    readings: dict[Channel, Floats]
    ages: dict[Channel, Any] = {}
    link = link_of(run.plant)
    if truth:
        imu = _values(run, PLANT_IMU, stamps)
        readings = {
            TRUE_PITCH_RATE: np.degrees(imu[:, 2:4]),
            TRUE_PITCH: np.degrees(imu[:, :2]),
            TRUE_POSITION: _values(run, PLANT_ODOM, stamps),
        }
        battery_count = 0.0
    else:
        readings = {
            GYRO: np.rint(np.degrees(_values(run, GYRO_IMU, stamps))),
            ENCODER: np.rint(np.degrees(_values(run, JOINT_STATES, stamps))),
        }
        ages = {
            GYRO: _age(run.attached.parameters.of(GyroParameters))
            + np.array([analog_age(link, stamp) / STEP_NS for stamp in stamps.tolist()])
            * link.is_on,
            ENCODER: _age(run.attached.parameters.of(EncoderParameters)),
        }
        measured = ~np.isnan(battery)
        counts = [count_of(battery_mv(volts)) for volts in battery[measured].tolist()]
        battery[measured] = np.multiply(counts, COUNT_V)
        battery_count = COUNT_V
    usable = run.balancing(time) & ~np.isnan(duty).any(axis=1)
    for values in readings.values():
        usable &= ~np.isnan(values).any(axis=1)
    if scenario := run.attached.scenario:
        for push in scenario.pushes:
            end = push.time + push.duration + _AFTER_PUSH_S
            usable &= (time < push.time - TICK_S) | (time > end)
    if missing := len(stamps) - len(run.series[MOTOR_DUTY].stamps):
        notes.append(f'{missing} missing ticks: no segment crosses a gap.')
    if run.damage:
        notes.append(run.damage)
    return Experiment(
        name=str(run.path),
        plant=plant,
        duty=np.nan_to_num(duty),
        readings=readings,
        battery=battery,
        battery_count=battery_count,
        usable=usable,
        ages=ages,
        battery_age=link.battery_age_ns // STEP_NS,
        delays_us=np.rint(np.nan_to_num(delays[:, 0]) * 1e6).astype(np.int64),
        notes=tuple(notes),
        recorded=recorded,
    )


def _tick_stamps(run: RunData) -> NDArray[np.int64]:
    """Return the stamps [ns] of all ticks from the first duty to the last, without gaps."""
    if MOTOR_DUTY not in run.series:
        raise _not_recorded(run, MOTOR_DUTY)
    first, last = run.series[MOTOR_DUTY].stamps[[0, -1]]
    return np.arange(first, last + 1, TICK_NS)


def _values(run: RunData, topic: Topic, stamps: NDArray[np.int64]) -> Floats:
    """Return the values of a topic at ticks, shape (n, k); NaN where one is missing."""
    if topic not in run.series:
        raise _not_recorded(run, topic)
    return np.array(run.series[topic].at(stamps), float)


def _not_recorded(run: RunData, topic: Topic) -> IdentificationError:
    return IdentificationError(f'{run.path}: topic {topic.name!r} was not recorded')


def _age(device: DeviceParameters) -> int:
    """Return the mean dead time of a device [physics steps]."""
    return round(mean_delay(device.delay, device.delay_jitter, STEPS_PER_TICK))


SLOWEST_DUTIES_MS = 20
"""Longest time between the duties of a log, of which those between are interpolated [ms]."""

_LITTLE = 'It tells something of body and ball, but nothing of motors, dead zone and battery.'
NO_DUTIES = f'A data log has no duties, unless controller.log_content adds them. {_LITTLE}'
INTERPOLATED_DUTIES = 2.5, 'Duties between records are interpolated, so intervals are wide.'
UNKNOWN_PHASE = 10.0, 'Intervals are wide unless plant_sim.link_phase is known: try 0 and 1.'
"""How much wider intervals are, as measured (docs/identification.md), and why."""

SELDOM_DUTIES = (
    f'The duties are more than {SLOWEST_DUTIES_MS} ms apart, too far to tell those between '
    f'(controller.log_count {SLOWEST_DUTIES_MS // TICK_MS} would do). {_LITTLE}'
)

MAX_STEP_MS = TICK_MS
"""Longest step of the simulation between two records [ms]."""

SHORTEST_PERIOD_MS = 80
"""Shortest time between records [ms]. Of a log with more, only some are used: the motor voltages
between them are unknowns."""

LONGEST_PERIOD_MS = 255 * TICK_MS
"""Longest time between records [ms], that of the largest `log_count`."""

_LOGGED = attrgetter('adc1', 'adc2', 'rev_b', 'rev_c', 'data1', 'data2', 'battery_mv')
_JITTER = 0.1
_FALLEN_DEG = 30.0
"""Pitch from which the robot cannot be saved. The range of the log ends at 32 degrees."""


def logged_experiment(path: Path, known: Mapping[str, Value]) -> Experiment:
    """Return the experiment in the data log of a real robot, from where it starts to move.

    `known` has values of the plant by name; those that are missing are the document's. It raises
    RecordingError if the file can't be read, and IdentificationError if it has fewer than two
    records, or they are too far apart.
    """
    with open_recording(path) as reader:
        packets = last_log(reader)
    if len(packets) < 2:
        raise IdentificationError(f'{path}: has {len(packets)} records; at least 2 are needed')
    intervals = np.diff([each.time_ms for each in packets]) % CLOCK_PERIOD_MS
    period = int(np.median(intervals))
    # The numbers of the records after gaps.
    gaps = np.flatnonzero(np.abs(intervals - period) > _JITTER * period) + 1
    if period > LONGEST_PERIOD_MS:
        raise IdentificationError(
            f'{path}: its records are {period} ms apart; those of a brick are at most '
            f'{LONGEST_PERIOD_MS} ms'
        )
    notes = []
    if gaps.size:
        noun = 'gap' if gaps.size == 1 else 'gaps'
        notes.append(f'{gaps.size} {noun} between records: no segment crosses one.')
    has_duties = any(each.data1 or each.data2 for each in packets)
    if has_duties and TICK_MS <= period <= SLOWEST_DUTIES_MS:
        intervals[gaps - 1] = 2 * period  # however long a gap is
        ticks = np.rint(np.append(0, np.cumsum(intervals)) / TICK_MS).astype(np.intp)
        return _driven_experiment(str(path), known, packets, ticks, notes)
    every = -(-SHORTEST_PERIOD_MS // period)
    if every > 1:
        # Of each piece between gaps, the records at longer steps.
        numbers = np.arange(len(packets))
        begins = np.zeros(len(packets), np.intp)
        begins[gaps] = gaps
        chosen = np.flatnonzero((numbers - np.maximum.accumulate(begins)) % every == 0)
        packets = [packets[number] for number in chosen]
        gaps = np.searchsorted(chosen, gaps)
        period *= every
    plant = PlantParameters().with_values(known)
    pitch = np.array([(each.adc1, each.adc2) for each in packets]) * ControllerParameters().lsb
    shaft = np.array([(each.rev_b, each.rev_c) for each in packets], np.float64)
    # In a gap, one missing record separates those before from those after.
    usable = np.insert(_usable(pitch, shaft), gaps, False)
    pitch, shaft = (np.insert(each, gaps, np.nan, axis=0) for each in (pitch, shaft))
    wheel = _wheel(shaft, math.degrees(plant.backlash) / 2.0)
    notes.insert(0, SELDOM_DUTIES if has_duties else NO_DUTIES)
    steps = -(-period // MAX_STEP_MS)
    return Experiment(
        name=str(path),
        plant=replace(plant, backlash=0.0, plant_model='linear'),
        duty=None,
        readings={LOGGED_PITCH: pitch, LOGGED_ENCODER: wheel},
        battery=np.full(len(usable), np.nan),
        battery_count=0.0,
        usable=usable,
        notes=tuple(notes),
        steps_per_reading=steps,
        step_s=period * 1e-3 / steps,
    )


def _driven_experiment(
    name: str,
    known: Mapping[str, Value],
    packets: Sequence[LogPacket],
    ticks: NDArray[np.intp],
    notes: Sequence[str],
) -> Experiment:
    """Return the experiment in a data log with duties, with readings in the ticks of its records.

    Robot and delays are those of a brick, unless `known` has others: its battery sags, and link and
    kernel delay gyro readings and duties.
    """
    brick = PlantParameters(link=True, kernel=True, battery_model='draining').with_values(known)
    program = ControllerParameters(link=brick.link, kernel=brick.kernel)
    phases = (0, 1) if brick.link_phase < 0 else (brick.link_phase,)
    delays = np.array([mean_delays(replace(program, link_phase=each)) for each in phases])
    gyro_ms, duty_ms = delays.mean(axis=0)
    columns = np.array([_LOGGED(each) for each in packets], np.float64)
    columns[:, :2] *= ControllerParameters().lsb
    count, duty_ticks = int(ticks[-1]) + 1, int(np.median(np.diff(ticks)))
    read = np.full((count, columns.shape[1]), np.nan)
    read[ticks] = columns
    filled = np.array([np.interp(np.arange(count), ticks, each) for each in columns.T]).T
    usable = _usable(filled[:, :2], filled[:, 2:4])
    usable[:-1] &= ~np.repeat(np.diff(ticks) > 1.5 * duty_ticks, np.diff(ticks))
    factor, reason = 1.0, ''
    if duty_ticks > 1:
        factor, reason = INTERPOLATED_DUTIES
    elif np.ptp(delays[:, 0]):
        factor, reason = UNKNOWN_PHASE
    return Experiment(
        name=name,
        plant=brick,
        duty=np.rint(filled[:, 4:6]).astype(np.int64),
        readings={LOGGED_PITCH: read[:, :2], ENCODER: read[:, 2:4]},
        battery=read[:, 6] * 1e-3,
        battery_count=COUNT_V,
        usable=usable,
        ages={LOGGED_PITCH: gyro_ms * STEPS_PER_TICK / TICK_MS},
        battery_age=link_of(brick).battery_age_ns // STEP_NS,
        delays_us=np.full(count, round(duty_ms * 1000.0)),
        interval_factor=factor,
        notes=(*[reason][: factor > 1.0], *notes),
    )


def _wheel(shaft: Floats, half_play: float) -> Floats:
    """Return the wheel's angles [deg] for those of the shaft, from which it differs by gear play.

    It is known where the shaft turns one way, before and after a record; elsewhere it is NaN.
    """
    if not half_play:
        return shaft
    steps = np.sign(np.diff(shaft, axis=0))
    before = np.concatenate([steps[:1], steps])
    after = np.concatenate([steps, steps[-1:]])
    return np.asarray(np.where(before * after > 0.0, shaft + half_play * before, np.nan))


def _usable(pitch: Floats, shaft: Floats) -> NDArray[np.bool_]:
    """Return a mask of the records from the first turn of a motor until the robot has fallen."""
    moved = (shaft != shaft[0]).any(axis=1)
    fallen = (np.abs(pitch) >= _FALLEN_DEG).any(axis=1)
    return np.logical_or.accumulate(moved) & ~np.logical_or.accumulate(fallen)
