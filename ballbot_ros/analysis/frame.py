"""A recorded run as a data frame: one row per tick, with units in the names of the columns."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ballbot_ros.analysis.run_data import Integers, RunData, Series
from ballbot_ros.analysis.run_metrics import estimated_pitch, estimated_position
from ballbot_ros.analysis.table import plane_columns
from ballbot_ros.errors import BallbotError
from ballbot_ros.messages.topics import (
    BATTERY_STATE,
    CONTROLLER_STATE,
    GYRO_IMU,
    JOINT_STATES,
    MOTOR_DUTY,
    PLANT_IMU,
    PLANT_JOINT_STATES,
    PLANT_ODOM,
    SONAR_RANGE,
)
from ballbot_ros.timing import SECOND_NS

if TYPE_CHECKING:
    import pandas

Columns = Mapping[str, NDArray[Any]]


def frame_of(run: RunData) -> pandas.DataFrame:
    """Return the signals of a run, one row per tick; the index is the time since the start [s].

    Position, body pitch, motor rate and torque are the true ones; `gyro` includes its offset. A
    signal without a sample at a tick is NaN. Signals that are sampled less often than the plant
    (distance, battery voltage, and in free-running mode the duty) keep their newest value.

    Raises
    ------
    BallbotError
        If pandas is not installed.
    """
    try:
        import pandas
    except ImportError:
        raise BallbotError(
            'pandas not found: install it with `pip install "ballbot_ros[pandas]"`'
        ) from None
    ticks = next(run.series[t] for t in (PLANT_IMU, PLANT_ODOM, *run.series) if t in run.series)
    columns: dict[str, NDArray[Any]] = {}
    for some in _columns(run, ticks.stamps):
        columns |= some
    start_ns = ticks.stamps[0] - round(ticks.time[0] * SECOND_NS)
    time = pandas.Index((ticks.stamps - start_ns) / SECOND_NS, name='time_s')
    frame = pandas.DataFrame(columns, index=time, dtype=float)
    frame['operating_state'] = pandas.Categorical(_states(run, ticks))
    return frame


def _columns(run: RunData, stamps: Integers) -> Iterator[Columns]:
    series = run.series
    if odometry := series.get(PLANT_ODOM):
        yield plane_columns('position', 'm', odometry.at(stamps))
    if body := series.get(PLANT_IMU):
        values = np.degrees(body.at(stamps))
        yield plane_columns('pitch', 'deg', values[:, :2])
        yield plane_columns('pitch_rate', 'deg_per_s', values[:, 2:])
    if motors := series.get(PLANT_JOINT_STATES):
        values = motors.at(stamps)
        yield plane_columns('motor_rate', 'deg_per_s', np.degrees(values[:, :2]))
        yield plane_columns('motor_torque', 'n_m', values[:, 2:])
    if duty := series.get(MOTOR_DUTY):
        values = duty.at(stamps) if run.plant.lockstep else _held(duty, stamps)
        yield plane_columns('duty', 'percent', values)
    if gyro := series.get(GYRO_IMU):
        yield plane_columns('gyro', 'deg_per_s', _whole_degrees(gyro, stamps))
    if encoders := series.get(JOINT_STATES):
        yield plane_columns('encoder', 'deg', _whole_degrees(encoders, stamps))
    if sonar := series.get(SONAR_RANGE):
        yield {'distance_m': _held(sonar, stamps)[:, 0]}
    if battery := series.get(BATTERY_STATE):
        yield {'battery_v': _held(battery, stamps)[:, 0]}
    if CONTROLLER_STATE in series:
        yield plane_columns('estimated_position', 'm', estimated_position(run, stamps))
        yield plane_columns('estimated_pitch', 'deg', np.degrees(estimated_pitch(run, stamps)))


def _whole_degrees(series: Series, stamps: Integers) -> NDArray[Any]:
    """Return a reading of the brick, which counts in degrees."""
    return np.asarray(np.rint(np.degrees(series.at(stamps))))


def _held(series: Series, stamps: Integers) -> NDArray[Any]:
    """Return the newest values at `stamps`, shape (m, k); NaN before the first sample."""
    rows = np.searchsorted(series.stamps, stamps, side='right') - 1
    return np.where(rows[:, np.newaxis] < 0, np.nan, series.values[rows.clip(min=0)])


def _states(run: RunData, ticks: Series) -> NDArray[Any]:
    """Return the operating state at each tick; None if it is unknown."""
    names = np.full(len(ticks.time), None, dtype=object)
    for each in run.states:
        names[(ticks.time >= each.start - 1e-9) & (ticks.time < each.end - 1e-9)] = each.name
    return names
