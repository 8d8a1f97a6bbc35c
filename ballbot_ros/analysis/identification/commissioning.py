"""Commissioning: gyros and motors of a robot from the log of the commissioning program."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.special import ndtr, stdtrit

from ballbot_ros.analysis.data_log import last_log
from ballbot_ros.controllers.commissioning import END, PLAY, PORTS, RAMP, REST, TILT
from ballbot_ros.errors import IdentificationError
from ballbot_ros.parameters import PLANT, GyroParameters, PlantParameters
from ballbot_ros.recording.messages.recording_files import open_recording
from ballbot_ros.robot.arithmetic import Floats
from ballbot_ros.robot.brick.bluetooth import elapsed
from ballbot_ros.robot.brick.sensors import COUNT_V

GYROS, MOTORS = ('gyro x', 'gyro y'), ('motor B', 'motor C')

_TWO_SIGMA = 1.96

MIN_NOISE = 0.23
"""Noise [deg/s] below which the rounding of the readings hides it, and what it is added to."""

_FIRST_NOISE, _ROUNDS = 0.3, 50
_CONVERGED = 1e-6
_FIRST_FIT = 3.0, -1.0
"""Dead zone [%] and offset [rad/s] to start from."""

BLOCK = 100
"""Readings (2 s) whose mean shows how well the drift is described."""

MIN_REST = 0.2
"""Shortest rest, as a part of the drift's period: a shorter one tells no drift from an offset."""

MAX_DRIFT_MISFIT = 1.5
"""Scatter of those means, relative to that of the noise, from which a note says so."""

NEAR_DEAD_ZONE = 4.0
"""Duties [%] this close to the dead zone are not used: the gear play is taken up there."""

MIN_STEPS, MIN_PAIRS = 40, 4
_ROUNDED_ANGLES = 6
"""Variances of a rounded angle in the difference of two turns, which share the middle one."""
MAX_SLOPE_ERROR = 0.1
"""Half an interval of the slope, as a part of it, from which the battery voltages are too alike."""

MIN_TURN_DEG, MIN_TILT_DEG = 10.0, 10.0
"""Angles from which a pulse turned a motor, and from which the user tilted the robot."""


class Estimate(NamedTuple):
    """A value and half of its 95 % interval."""

    value: float
    half_width: float


@dataclass(frozen=True)
class MeasuredParameter:
    """A parameter of a profile, as the logs tell it.

    `of_devices` has its estimates by gyro or motor; the parameter is that of both.
    """

    node: str
    name: str
    estimate: Estimate
    of_devices: Mapping[str, Estimate]


@dataclass(frozen=True)
class RestingGyro:
    """A gyro at rest in one log.

    Attributes
    ----------
    time, means, drift_curve : ndarray, shape (n,)
        The time since the rest began [s]; means of :data:`BLOCK` readings, and the fitted sine
        there [deg/s].
    misfit : float
        Scatter of the means around it, relative to what the noise explains; at least 1.
    """

    offset: Estimate
    drift: Estimate
    noise: Estimate
    time: Floats
    means: Floats
    drift_curve: Floats
    misfit: float


@dataclass(frozen=True)
class RampedMotor:
    """A motor on the ramp, in all logs.

    Attributes
    ----------
    duty, battery, speed : ndarray, shape (n,)
        Of each step [%, V, rad/s].
    log : ndarray of int, shape (n,)
        The number of the log that a step is in.
    dead_zone, offset, slope : Estimate
        Duty lost to friction [%], and speed at a duty of 100 % over the battery's voltage [rad/s,
        rad/s/V]. The slope has no interval if it is not told by the logs.
    """

    duty: Floats
    battery: Floats
    speed: Floats
    log: NDArray[np.intp]
    dead_zone: Estimate
    offset: Estimate
    slope: Estimate

    def speed_at(self, duty: Floats, battery: Floats | float) -> Floats:
        """Return the speed [rad/s] that the estimates give for duties [%] and voltages [V]."""
        values = np.array([each.value for each in (self.dead_zone, self.offset, self.slope)])
        return _speed(values, duty, battery)


@dataclass(frozen=True)
class Commissioning:
    """What the logs of one robot tell.

    Attributes
    ----------
    rests : mapping of str to tuple of RestingGyro
        By gyro, one of each log that has a rest.
    ramps : mapping of str to RampedMotor
        By motor; empty if no log has a ramp.
    plays : mapping of str to ndarray
        By motor, by how much less each first pulse after a reversal turned it [deg].
    checks, notes : tuple of str
        What the logs tell of ports and signs, and what the estimates depend on.
    """

    logs: tuple[Log, ...]
    parameters: tuple[MeasuredParameter, ...]
    rests: Mapping[str, tuple[RestingGyro, ...]]
    ramps: Mapping[str, RampedMotor]
    plays: Mapping[str, Floats]
    checks: tuple[str, ...]
    notes: tuple[str, ...]


@dataclass(frozen=True)
class Log:
    """The records of one run of the program.

    Attributes
    ----------
    time, battery : ndarray, shape (n,)
        [s], [V].
    phase : ndarray of int, shape (n,)
        As in :mod:`ballbot_ros.controllers.commissioning`.
    duty, shaft, gyro : ndarray, shape (n, 2)
        Of both planes, [%], [deg], [deg/s].
    follows : ndarray of bool, shape (n,)
        Whether the record before has not been lost.
    """

    path: Path
    time: Floats
    battery: Floats
    phase: NDArray[np.intp]
    duty: Floats
    shaft: Floats
    gyro: Floats
    follows: NDArray[np.bool_]

    @classmethod
    def read(cls, path: Path) -> Log:
        """Read a recording of `ballbot brick drive`, or a data log as CSV: its last run.

        It raises RecordingError if the file can't be read, and IdentificationError if it is not a
        log of the commissioning program.
        """
        with open_recording(path) as reader:
            packets = last_log(reader)
        phase = np.array([each.adc1 for each in packets], np.intp)
        gyro = np.array([(each.adc3, each.adc4) for each in packets], float).reshape(-1, 2)
        is_log = len(packets) > 1 and gyro.any() and not any(each.adc2 for each in packets)
        if not (is_log and phase[0] >= 0 and phase[-1] <= END and (np.diff(phase) >= 0).all()):
            raise IdentificationError(
                f'{path}: not a log of the commissioning program, which '
                '`codegen --program commissioning` generates'
            )
        time_ms = np.array([elapsed(packets[0], each) for each in packets])
        steps = np.diff(time_ms, prepend=-1e9)
        return cls(
            path=path,
            time=time_ms / 1000.0,
            battery=np.array([each.battery_mv for each in packets]) / 1000.0,
            phase=phase,
            duty=np.array([(each.data1, each.data2) for each in packets], float),
            shaft=np.array([(each.rev_b, each.rev_c) for each in packets], float),
            gyro=gyro,
            follows=steps < 1.5 * np.median(steps[1:]),
        )

    def turn(self, motor: int) -> float:
        """Return how far a motor has turned the way of its duty [deg]."""
        return float(np.sign(self.duty[:-1, motor]) @ np.diff(self.shaft[:, motor]))

    def starts(self, phase: int, motor: int) -> NDArray[np.intp]:
        """Return the first record of each part of a phase with one duty, and of what follows."""
        numbers = np.flatnonzero(self.phase == phase)
        if not numbers.size:
            return numbers
        duties = self.duty[numbers, motor]
        begins = numbers[np.flatnonzero(np.diff(duties, prepend=np.nan) != 0.0)]
        return np.append(begins, min(numbers[-1] + 1, len(self.time) - 1))


def commission(
    paths: Sequence[Path], plant: PlantParameters, gyro: GyroParameters
) -> Commissioning:
    """Return what logs of the commissioning program tell of a robot.

    Equation (6.1) is told by the speed of the motors, for the motor constants of `plant`; with
    battery voltages that are too alike, its slope is that of `plant`. The drift is a sine with the
    period that `gyro` has. It raises RecordingError if a file can't be read, and
    IdentificationError if it is no such log, or nothing can be told.
    """
    logs = tuple(Log.read(path) for path in paths)
    rests = {
        name: tuple(
            rest
            for log in logs
            if np.count_nonzero(at := log.phase == REST) > BLOCK
            and np.ptp(log.time[at]) >= MIN_REST * gyro.drift_period
            and (rest := _rest(log.time[at], log.gyro[at, number], gyro.drift_period))
        )
        for number, name in enumerate(GYROS)
    }
    ramps, plays, notes = {}, {}, []
    for number, name in enumerate(MOTORS):
        turning = [log for log in logs if log.turn(number) >= MIN_TURN_DEG]
        ramp = _ramp(turning, number, 1000.0 * plant.voltage_slope / volts_per_speed(plant))
        if ramp is not None:
            ramps[name] = ramp
        turns = np.array([turn for log in turning for turn in _missing_turns(log, number)])
        if len(turns) >= MIN_PAIRS:
            plays[name] = turns
    parameters = tuple(_measured(rests, ramps, plays, plant))
    if not parameters:
        raise IdentificationError(
            f'{paths[0]}: ends before its phases have told anything; let the program end, and '
            'check the cables'
        )
    if not all(rests.values()):
        notes.append(
            f'no rest of {MIN_REST * gyro.drift_period:g} s in which both gyros scatter like '
            'noise: nothing is known of them'
        )
    for name in MOTORS:
        if name not in ramps:
            notes.append(f'no ramp turned {name} forward, so nothing is known of its speed')
        if name not in plays:
            notes.append(f'no pulses turned {name} forward, so nothing is known of its gear play')
    if any(rest.misfit > MAX_DRIFT_MISFIT for each in rests.values() for rest in each):
        notes.append(
            f'the drift is not a sine with the period {gyro.drift_period:g} s: its intervals and '
            'those of the offsets are wider for that, and the noise contains some of it'
        )
    elif all(rests.values()):
        notes.append(f'drift and offsets are those for a period of {gyro.drift_period:g} s')
    if ramps and not any(each.slope.half_width for each in ramps.values()):
        notes.append(
            'the battery voltages are too alike to tell the slope of equation (6.1): the offset is '
            'that for the slope of the profile; add a log with another battery voltage'
        )
    checks = tuple(line for log in logs for line in (*_port_checks(log), *_tilt_checks(log)))
    return Commissioning(logs, parameters, rests, ramps, plays, checks, tuple(notes))


def _measured(
    rests: Mapping[str, Sequence[RestingGyro]],
    ramps: Mapping[str, RampedMotor],
    plays: Mapping[str, Floats],
    plant: PlantParameters,
) -> Iterator[MeasuredParameter]:
    found: defaultdict[tuple[str, str], dict[str, Estimate]] = defaultdict(dict)
    for name, of in {'zero_rate_offset_{}': 'offset', 'noise': 'noise', 'drift': 'drift'}.items():
        for axis, (gyro, each) in zip('xy', rests.items(), strict=True):
            if all(rests.values()):
                estimate = pooled([getattr(rest, of) for rest in each])
                found[GyroParameters.node, name.format(axis)][gyro] = estimate
    volts = volts_per_speed(plant)
    for motor, ramp in ramps.items():
        found[PLANT, 'dead_zone'][motor] = ramp.dead_zone
        if ramp.slope.half_width:
            found[PLANT, 'voltage_slope'][motor] = _times(ramp.slope, volts / 1000.0)
        found[PLANT, 'voltage_offset'][motor] = _times(ramp.offset, volts)
    for motor, turns in plays.items():
        scatter = max(float(turns.std(ddof=1)), math.sqrt(_ROUNDED_ANGLES / 12.0))
        error = float(stdtrit(len(turns) - 1, 0.975)) * scatter / math.sqrt(len(turns))
        play = Estimate(float(turns.mean()), error)
        found[PLANT, 'backlash'][motor] = _times(play, math.radians(1.0))
    for (node, name), devices in found.items():
        # Both motors have the same duties, and the same readings of the battery.
        estimate = pooled([*devices.values()], independent=node != PLANT)
        yield MeasuredParameter(node, name, estimate, devices)


def volts_per_speed(plant: PlantParameters) -> float:
    """Return the voltage at which a motor without load turns at 1 rad/s [V·s/rad].

    It raises IdentificationError if a motor of the profile has no such speed.
    """
    if not (plant.torque_constant and (plant.back_emf_constant or plant.motor_friction)):
        raise IdentificationError(
            'a motor of the profile has no speed without load: plant_sim.torque_constant, or '
            'back_emf_constant and motor_friction, must be larger than 0'
        )
    friction = plant.motor_friction * plant.motor_resistance / plant.torque_constant
    return plant.back_emf_constant + friction


def _times(estimate: Estimate, factor: float) -> Estimate:
    return Estimate(estimate.value * factor, estimate.half_width * factor)


def pooled(estimates: Sequence[Estimate], *, independent: bool = True) -> Estimate:
    """Return the weighted mean; its interval is wider if the values differ by more than theirs.

    Errors that are not independent do not cancel each other.
    """
    values, half_widths = np.array(estimates).T
    weights = half_widths**-2.0
    mean = float(np.average(values, weights=weights))
    excess = _TWO_SIGMA**2 * float(weights @ (values - mean) ** 2) / max(1, len(values) - 1)
    count = 1 if independent else len(values)
    return Estimate(mean, math.sqrt(max(1.0, excess) * count / float(weights.sum())))


def _rest(time: Floats, readings: Floats, period: float) -> RestingGyro | None:
    """Return what the readings of a gyro at rest tell; its drift is a sine with that period.

    None if they hardly change: it is not connected, or the rounding hides everything.
    """
    time = time - time[0]
    phase = 2.0 * math.pi * (time / period)
    design = np.column_stack([np.ones_like(phase), np.sin(phase), np.cos(phase)])
    if (found := _most_likely(design, readings)) is None:
        return None
    curve, noise, covariance = found
    count = len(readings) // BLOCK
    times, means, drift_curve = (
        values[: count * BLOCK].reshape(count, BLOCK).mean(axis=1)
        for values in (time, readings, design @ curve)
    )
    scatter = math.sqrt((noise**2 + 1.0 / 12.0) / BLOCK)
    misfit = max(1.0, float(np.sqrt(np.mean((means - drift_curve) ** 2))) / scatter)
    covariance *= (_TWO_SIGMA * misfit) ** 2
    amplitude, of_amplitude = curve[1:], covariance[1:3, 1:3]
    # Errors lengthen a vector on average.
    excess = float(np.trace(of_amplitude)) / _TWO_SIGMA**2
    drift = math.sqrt(max(0.0, float(amplitude @ amplitude) - excess))
    along = amplitude / max(1e-9, float(np.linalg.norm(amplitude)))
    return RestingGyro(
        offset=Estimate(float(curve[0]), math.sqrt(covariance[0, 0])),
        drift=Estimate(drift, math.sqrt(float(along @ of_amplitude @ along))),
        noise=Estimate(noise, math.sqrt(covariance[3, 3])),
        time=times,
        means=means,
        drift_curve=drift_curve,
        misfit=misfit,
    )


def _most_likely(design: Floats, readings: Floats) -> tuple[Floats, float, Floats] | None:
    """Return what readings rounded to whole numbers most likely come from; None if that hides it.

    Parameters
    ----------
    design : ndarray, shape (n, k)
        The mean of the readings is this times the coefficients.

    Returns
    -------
    coefficients : ndarray, shape (k,)
    noise : float
        Its standard deviation.
    covariance : ndarray, shape (k + 1, k + 1)
        Of the errors of both.
    """
    count = design.shape[1] + 1
    curve = np.asarray(np.linalg.lstsq(design, readings, rcond=None)[0], np.float64)
    noise = max(_FIRST_NOISE, float((readings - design @ curve).std()))
    for _ in range(_ROUNDS):
        low, high = ((readings + side - design @ curve) / noise for side in (-0.5, 0.5))
        # From the tail below: that above has no digits left a few deviations away.
        ends = ndtr(np.where(low + high < 0.0, (low, high), (-high, -low)))
        chance = np.maximum(ends[1] - ends[0], 1e-300) * noise
        at_low, at_high = (np.exp(-0.5 * each**2) / math.sqrt(math.tau) for each in (low, high))
        of_mean, of_noise = at_low - at_high, low * at_low - high * at_high
        scores = np.column_stack([design * of_mean[:, None], of_noise]) / chance[:, None]
        information = scores.T @ scores
        if noise < 0.5 * MIN_NOISE or np.linalg.matrix_rank(information) < count:
            break
        step = np.linalg.solve(information, scores.sum(axis=0))
        curve += step[:-1]
        noise *= math.exp(max(-0.5, min(0.5, step[-1] / noise)))
        if float(step @ information @ step) < _CONVERGED and noise >= MIN_NOISE:
            return curve, noise, np.asarray(np.linalg.inv(information))
    return None


def _speed(values: Floats, duty: Floats, battery: Floats | float) -> Floats:
    """Return the speed [rad/s] for dead zone, offset and slope, as in RampedMotor."""
    dead_zone, offset, slope = values
    effective = np.sign(duty) * np.maximum(np.abs(duty) - dead_zone, 0.0)
    return np.asarray(effective / 100.0 * (slope * battery + offset))


def _ramp(logs: Sequence[Log], motor: int, known_slope: float) -> RampedMotor | None:
    """Return what the ramps tell of a motor; None if they have too few steps."""
    steps = np.array(
        [(*each, number) for number, log in enumerate(logs) for each in _steps(log, motor)]
    ).reshape(-1, 4)
    if len(steps) < MIN_STEPS:
        return None
    first, _ = _fit(steps, (*_FIRST_FIT, known_slope), free=2)
    used = steps[np.abs(np.abs(steps[:, 0]) - first[0]) >= NEAR_DEAD_ZONE]
    values, errors = _fit(used, first, free=3)
    if errors[2] > MAX_SLOPE_ERROR * abs(values[2]):
        values, errors = _fit(used, first, free=2)
    dead_zone, offset, slope = (
        Estimate(float(value), float(error)) for value, error in zip(values, errors, strict=True)
    )
    duty, battery, speed, log = steps.T
    return RampedMotor(duty, battery, speed, log.astype(np.intp), dead_zone, offset, slope)


def _fit(steps: Floats, start: Sequence[float] | Floats, free: int) -> tuple[Floats, Floats]:
    """Fit the first `free` of dead zone, offset and slope, and keep the others.

    The steps, shape (n, 4), are duty, battery voltage, speed, and number of the log. It returns the
    values and half of the widths of their intervals, shape (3,).
    """
    duty, battery, speed, log = steps.T
    kept = np.array(start[free:])

    def residuals(values: Floats) -> Floats:
        return np.asarray(_speed(np.append(values, kept), duty, battery) - speed)

    found = least_squares(residuals, start[:free])
    values = np.append(found.x, kept)
    inverse = np.linalg.pinv(found.jac.T @ found.jac)
    covariance = inverse * (2.0 * found.cost / max(1, len(steps) - free))
    per_volt = _speed(np.array([values[0], 0.0, values[2]]), duty, 1.0)
    for number in np.unique(log):
        # The voltages of one log are so alike that rounding shifts them all together.
        shift = inverse @ found.jac.T @ np.where(log == number, per_volt, 0.0)
        covariance += np.outer(shift, shift) * (COUNT_V**2 / 12.0)
    return values, np.append(_TWO_SIGMA * np.sqrt(np.diag(covariance)), np.zeros(len(kept)))


def _steps(log: Log, motor: int) -> Iterator[tuple[float, float, float]]:
    """Yield duty [%], battery voltage [V] and speed [rad/s] of each step without a gap."""
    for begin, end in pairwise(log.starts(RAMP, motor)):
        # A duty acts a little later than the record that has it.
        first = begin + 1
        if end - first >= 2 and log.follows[first : end + 1].all():
            angle = log.shaft[end, motor] - log.shaft[first, motor]
            speed = math.radians(angle) / (log.time[end] - log.time[first])
            yield log.duty[begin, motor], float(log.battery[first : end + 1].mean()), speed


def _missing_turns(log: Log, motor: int) -> Iterator[float]:
    """Yield by how much less the first pulse after each reversal turned a motor [deg]."""
    starts = log.starts(PLAY, motor)
    # The record before a pulse has the resting motor; the first one of it may already have it move.
    angles = np.where(log.follows[starts], log.shaft[np.maximum(starts - 1, 0), motor], np.nan)
    duties = log.duty[starts, motor]
    pulses = np.flatnonzero(duties[:-2])
    for before, first, second in zip(pulses, pulses[1:], pulses[2:], strict=False):
        if duties[before] * duties[first] < 0.0 and duties[first] == duties[second]:
            way = math.copysign(1.0, duties[first])
            turned = [way * (angles[pulse + 2] - angles[pulse]) for pulse in (first, second)]
            if turned[1] >= MIN_TURN_DEG and not math.isnan(turned[0]):
                yield turned[1] - turned[0]


def _port_checks(log: Log) -> Iterator[str]:
    """Yield what the pulses on one motor alone turned."""
    for motor, name in enumerate(MOTORS):
        for begin, end in pairwise(log.starts(PORTS, motor)):
            if duty := log.duty[begin, motor]:
                turned = (log.shaft[end] - log.shaft[begin]).tolist()
                told = (
                    f'{log.path}: {duty:+.0f} % on {name} turned B by {turned[0]:+.0f}° and C by '
                )
                told += f'{turned[1]:+.0f}°'
                if abs(turned[1 - motor]) >= MIN_TURN_DEG:
                    told += f': wrong, only {name} may turn'
                elif turned[motor] * duty < MIN_TURN_DEG * abs(duty):
                    told += f': wrong, {name} must turn that way'
                yield told


def _tilt_checks(log: Log) -> list[str]:
    """Return what the gyros saw of the tilts, forward and then to the right."""
    numbers = np.flatnonzero(log.phase == TILT)
    rest = log.gyro[log.phase == REST]
    forward, rightward = np.array_split(numbers, 2)
    if len(forward) < 2 or len(rightward) < 2 or not len(rest):
        return []
    seen = []
    for part in (forward, rightward):
        rates = log.gyro[part[1:]] - rest.mean(axis=0)
        angles = np.cumsum(rates * np.diff(log.time[part])[:, None], axis=0)
        seen.append(angles[np.abs(angles).argmax(axis=0), [0, 1]].tolist())
    (forward_x, forward_y), (_, rightward_y) = seen
    told = f'{log.path}: tilted forward, gyro x saw {forward_x:+.0f}° and gyro y {forward_y:+.0f}°'
    if max(abs(forward_x), abs(forward_y)) < MIN_TILT_DEG:
        return [f'{told}: not tilted, so nothing is known of the ports and signs of the gyros']
    if abs(forward_y) > abs(forward_x):
        return [f'{told}: wrong, each is in the port of the other']
    right = f'{log.path}: tilted to the right, gyro y saw {rightward_y:+.0f}°'
    return [
        told + (': wrong, gyro x is mounted the other way round' if forward_x < 0.0 else ''),
        right + (': wrong, gyro y is mounted the other way round' if rightward_y < 0.0 else ''),
    ]
