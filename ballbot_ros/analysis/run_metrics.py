"""Metrics that need more than the true motion and the duties of a recorded run."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from functools import partial

import numpy as np
from numpy.typing import NDArray

from ballbot_ros.analysis.metrics import HALF_TICK_S
from ballbot_ros.analysis.run_data import RunData, seconds
from ballbot_ros.controllers.interface import OperatingState
from ballbot_ros.engine.scenario.metrics import MetricRegistry
from ballbot_ros.parameters import CONTROLLER, PLANT, ControllerParameters
from ballbot_ros.parameters.timing import RESEND_S, TICK_NS
from ballbot_ros.recording.messages.topics import (
    BATTERY_STATE,
    CONTROLLER_STATE,
    GYRO_IMU,
    MOTOR_DUTY,
    PLANT_IMU,
    PLANT_JOINT_STATES,
    PLANT_ODOM,
)
from ballbot_ros.robot.arithmetic import Floats

RUN_METRICS = MetricRegistry[RunData]()
"""Metrics of recorded runs in addition to those of expectations; NaN if the file lacks the data."""

_MEAN_S = 1.0
_MEAN_ROWS = 2**13
"""Number of means computed together, which bounds the memory."""


def estimated_position(run: RunData, stamps: NDArray[np.int64]) -> Floats:
    """Return the position [m] estimated by the controller at `stamps`, shape (n, 2).

    It is NaN while the controller is not active.
    """
    return _position(run, _controller_state(run, stamps, [0, 2]))


def reference_position(run: RunData, stamps: NDArray[np.int64]) -> Floats:
    """Return the position [m] to which the controller steers at `stamps`, shape (n, 2).

    It is NaN while the controller is not active, and if the controller publishes no reference.
    """
    return _position(run, _controller_state(run, stamps, [6, 7]))


def reference_speed(run: RunData, stamps: NDArray[np.int64]) -> Floats:
    """Return the speed [m/s] that goes with :func:`reference_position`."""
    radius = run.attached.parameters.of(ControllerParameters).ball_radius
    return np.asarray(radius * _controller_state(run, stamps, [8, 9]).astype(float))


def commanded_speed(run: RunData, stamps: NDArray[np.int64]) -> Floats:
    """Return the speed [m/s] that the sticks, or the autonomous drive, command, shape (n, 2).

    The document's program follows it by a low pass, its reference; here that is undone. It is NaN
    where this is not possible: with another controller, and where the tick before is missing.
    """
    reference = reference_speed(run, stamps)
    share = 1.0 - run.attached.parameters.of(ControllerParameters).a_r
    if not run.has_documents_program or not share:
        return np.full_like(reference, np.nan)
    reference[1:] -= (1.0 - share) * reference[:-1]
    reference[1:][np.diff(stamps) != TICK_NS] = np.nan
    reference[:1] = np.nan
    return np.asarray(reference / share)


def ball_speed(run: RunData) -> Floats:
    """Return the true speed of the ball [m/s] from tick to tick, shape (n, 2), NaN at the first."""
    truth = run.series[PLANT_ODOM]
    speed = np.full(truth.values.shape, np.nan)
    np.divide(np.diff(truth.values, axis=0), np.diff(truth.time)[:, np.newaxis], out=speed[1:])
    return speed


def _position(run: RunData, angle: Floats) -> Floats:
    """Return the position of the ball [m] for its angle [rad] since the start."""
    radius = run.attached.parameters.of(ControllerParameters).ball_radius
    return np.asarray(radius * angle + [run.plant.start_position_x, run.plant.start_position_y])


def estimated_pitch(run: RunData, stamps: NDArray[np.int64]) -> Floats:
    """Return the pitch [rad] estimated by the controller at `stamps`, shape (n, 2).

    It is NaN while the controller is not active.
    """
    return _controller_state(run, stamps, [1, 3]).astype(float)


def _controller_state(run: RunData, stamps: NDArray[np.int64], columns: list[int]) -> Floats:
    """Return columns of ``controller/state`` at `stamps`, NaN while it is not active."""
    values = run.samples(CONTROLLER_STATE, stamps)[:, columns]
    values[~run.balancing(seconds(stamps) - run.start_ns * 1e-9)] = np.nan
    return values


def pitch_error(run: RunData) -> Floats:
    """Return the error of the estimated pitch [rad], shape (n, 2)."""
    if not {CONTROLLER_STATE, PLANT_IMU} <= run.series.keys():
        return np.zeros((0, 2))
    truth = run.series[PLANT_IMU]
    return np.asarray(estimated_pitch(run, truth.stamps) - truth.values[:, :2])


def position_error(run: RunData) -> Floats:
    """Return the error of the estimated position [m], shape (n, 2)."""
    if not {CONTROLLER_STATE, PLANT_ODOM} <= run.series.keys():
        return np.zeros((0, 2))
    truth = run.series[PLANT_ODOM]
    return np.asarray(estimated_position(run, truth.stamps) - truth.values)


def estimated_gyro_offset(run: RunData) -> Floats:
    """Return the gyro offset [deg/s] estimated by the controller, shape (n, 2).

    It is the gyro reading minus the pitch rate that the controller publishes.
    """
    gyro = run.series[GYRO_IMU]
    believed = gyro.values - run.series[CONTROLLER_STATE].at(gyro.stamps)[:, 4:6]
    believed[~run.balancing(gyro.time)] = np.nan
    return np.asarray(np.degrees(believed))


def true_gyro_offset(run: RunData) -> Floats:
    """Return the true gyro offset [deg/s], shape (n, 2).

    It is the reading minus the true rate, averaged over 1 s against noise and rounding.
    """
    gyro = run.series[GYRO_IMU]
    offset = gyro.values - run.series[PLANT_IMU].at(gyro.stamps)[:, 2:]
    _smooth(offset)
    return np.asarray(np.degrees(offset, out=offset))


def _smooth(values: Floats) -> None:
    """Replace each row by the mean over one second around it, or less at the ends."""
    half = int(_MEAN_S * 1e9 / TICK_NS) // 2
    count = len(values)
    sums = np.zeros((count + 1, values.shape[1]))
    np.cumsum(values, axis=0, out=sums[1:])
    for begin in range(0, count, _MEAN_ROWS):
        rows = np.arange(begin, min(begin + _MEAN_ROWS, count))
        first, last = (rows - half).clip(min=0), (rows + half + 1).clip(max=count)
        values[rows] = (sums[last] - sums[first]) / (last - first)[:, np.newaxis]


@RUN_METRICS.metric(
    'electrical energy drawn by the motors from the release on: voltage times current, from '
    'true torque and rate at every tick; braking returns none'
)
def energy_j(run: RunData) -> float:
    """Return the energy [J], with torque = Kt i and voltage = Rm i + Kb rate, both as in (3.16)."""
    if PLANT_JOINT_STATES not in run.series:
        return math.nan
    motors, plant = run.series[PLANT_JOINT_STATES], run.plant
    if len(motors.time) < 2 or not plant.torque_constant:
        return math.nan
    rate, current = motors.values[:, :2], motors.values[:, 2:] / plant.torque_constant
    voltage = plant.motor_resistance * current + plant.back_emf_constant * rate
    power = (voltage * current).sum(axis=1).clip(min=0.0)[:-1]
    released = motors.time[:-1] >= plant.hold_time - HALF_TICK_S
    return float((power * np.diff(motors.time))[released].sum())


@RUN_METRICS.metric('lowest terminal voltage')
def lowest_battery_v(run: RunData) -> float:
    if BATTERY_STATE not in run.series:
        return math.nan
    return float(run.series[BATTERY_STATE].values.min())


@RUN_METRICS.metric('time for which the controller was calibrated and in control')
def controlled_s(run: RunData) -> float:
    if CONTROLLER_STATE not in run.series:
        return math.nan
    time = run.series[CONTROLLER_STATE].time
    return float(np.diff(time)[run.balancing(time)[1:]].sum())


def _estimates(run: RunData) -> tuple[Floats, Floats]:
    """Return the estimated pitch [deg] and distance from the start [m] at all samples."""
    if CONTROLLER_STATE not in run.series:
        return np.zeros((0, 2)), np.zeros((0, 2))
    stamps, plant = run.series[CONTROLLER_STATE].stamps, run.plant
    start = plant.start_position_x, plant.start_position_y
    return np.degrees(estimated_pitch(run, stamps)), estimated_position(run, stamps) - start


@RUN_METRICS.metric('root mean square of the pitch estimated by the controller')
def estimated_pitch_rms_deg(run: RunData) -> float:
    return _rms(_estimates(run)[0])


@RUN_METRICS.metric('largest pitch estimated by the controller')
def peak_estimated_pitch_deg(run: RunData) -> float:
    return _peak(_estimates(run)[0])


@RUN_METRICS.metric("root mean square of the controller's estimate of the distance from the start")
def estimated_position_rms_m(run: RunData) -> float:
    return _rms(_estimates(run)[1])


@RUN_METRICS.metric("largest value of the controller's estimate of the distance from the start")
def peak_estimated_position_m(run: RunData) -> float:
    return _peak(_estimates(run)[1])


@RUN_METRICS.metric('root mean square of the error of the estimated pitch')
def pitch_error_rms_deg(run: RunData) -> float:
    return _rms(np.degrees(pitch_error(run)))


@RUN_METRICS.metric('root mean square of the error of the position estimated by the controller')
def position_error_rms_m(run: RunData) -> float:
    return _rms(position_error(run))


@RUN_METRICS.metric(
    "root mean square of the ball's speed minus the speed of the controller's reference, while it "
    'balances'
)
def speed_error_rms_m_per_s(run: RunData) -> float:
    if not {CONTROLLER_STATE, PLANT_ODOM} <= run.series.keys():
        return math.nan
    error = ball_speed(run)
    error -= reference_speed(run, run.series[PLANT_ODOM].stamps)
    return _rms(error)


def _offset_error(run: RunData, plane: int) -> float:
    if not {CONTROLLER_STATE, GYRO_IMU, PLANT_IMU} <= run.series.keys():
        return math.nan
    return _rms((estimated_gyro_offset(run) - true_gyro_offset(run))[:, plane])


for _number, _plane in enumerate('xy'):
    RUN_METRICS.metric(
        'root mean square of the error of the estimated gyro offset (reading minus estimated pitch '
        f'rate, against reading minus true rate, 1 s mean), plane {_plane}',
        f'gyro_offset_error_{_plane}_deg_per_s',
    )(partial(_offset_error, plane=_number))


def _time_in(run: RunData, state: str) -> float:
    if not run.states:
        return math.nan
    return sum(each.end - each.start for each in run.states if each.name == state)


for _state in OperatingState:
    RUN_METRICS.metric(f'time in the state {_state}', f'time_in_{_state}_s')(
        partial(_time_in, state=_state)
    )


@RUN_METRICS.metric('ticks, up to the last recorded one, whose truth or duty is not in the file')
def missing_ticks(run: RunData) -> float:
    return math.nan if run.is_real else run.missing_ticks


@RUN_METRICS.metric(
    'standard deviation of the sim time from duty to duty: 0 in lockstep, regardless of the wall '
    'clock'
)
def tick_jitter_ms(run: RunData) -> float:
    duty = run.series.get(MOTOR_DUTY)
    if run.is_real or duty is None or len(duty.stamps) < 2:
        return math.nan
    return float(np.diff(duty.stamps).std() * 1e-6)


@RUN_METRICS.metric(
    'ticks that were late by the wall clock, as the plant counts them in /diagnostics; free '
    'running, also those of the controller'
)
def late_ticks(run: RunData) -> float:
    late = _counter(run, PLANT, 'late ticks')
    if not run.plant.lockstep:
        late += _counter(run, CONTROLLER, 'late ticks')
    return late


@RUN_METRICS.metric(
    f'number of times that the plant sent a tick again, after {RESEND_S:g} s without an answer, '
    'from /diagnostics'
)
def resends(run: RunData) -> float:
    return _counter(run, PLANT, 'resends')


@RUN_METRICS.metric(
    'ticks per second of wall time, median of the values that the plant reports in /diagnostics'
)
def tick_rate_hz(run: RunData) -> float:
    reported = (_read(values, 'rate [Hz]') for values in _diagnostics(run, PLANT))
    rates = [rate for rate in reported if rate > 0.0]
    return float(np.median(rates)) if rates else math.nan


def _counter(run: RunData, role: str, key: str) -> float:
    """Return a counter in a node's last report; NaN if there is no report."""
    reports = list(_diagnostics(run, role))
    return _read(reports[-1], key) if reports else math.nan


def _diagnostics(run: RunData, role: str) -> Iterator[Mapping[str, str]]:
    """Iterate over the values reported by the node of a role in ``/diagnostics``."""
    for _, status in run.statuses:
        values = dict(status.values)
        if role == values.get('role'):
            yield values


def _read(values: Mapping[str, str], key: str) -> float:
    try:
        return float(values[key])
    except (KeyError, ValueError):
        return math.nan


def _peak(values: Floats) -> float:
    return float(np.nanmax(np.abs(values))) if np.isfinite(values).any() else math.nan


def _rms(values: Floats) -> float:
    known = values[~np.isnan(values)]
    return math.sqrt(float(np.mean(np.square(known, dtype=float)))) if known.size else math.nan
