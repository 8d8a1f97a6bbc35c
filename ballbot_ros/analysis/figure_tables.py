"""The numbers shown in the figures of a run."""

from __future__ import annotations

import numpy as np

from ballbot_ros.analysis.drawing import DUTY, PITCH, POSITION
from ballbot_ros.analysis.figure_parts import (
    Table,
    envelope,
    every_nth,
    plane_columns,
    track_columns,
)
from ballbot_ros.analysis.processor import ended, pieces, utilisation
from ballbot_ros.analysis.run_data import RunData, Series
from ballbot_ros.analysis.run_metrics import (
    ball_speed,
    commanded_speed,
    estimated_gyro_offset,
    estimated_pitch,
    estimated_position,
    reference_position,
    reference_speed,
    true_gyro_offset,
)
from ballbot_ros.parameters import ControllerParameters
from ballbot_ros.parameters.timing import TICK_S
from ballbot_ros.recording.messages.topics import (
    BATTERY_STATE,
    GAMEPAD_JOY,
    GYRO_IMU,
    MOTOR_DUTY,
    PLANT_IMU,
    PLANT_ODOM,
    SONAR_RANGE,
)
from ballbot_ros.robot.arithmetic import Floats
from ballbot_ros.robot.brick.job_times import bus_share, kernel_constants


def _table(series: Series, name: str, unit: str, values: Floats) -> Table:
    return envelope(series.time, plane_columns(name, unit, values))


def position_table(run: RunData) -> Table:
    """Return the true position [cm]."""
    series = run.series[PLANT_ODOM]
    return envelope(series.time, POSITION.columns(series.values * 100.0))


def pitch_table(run: RunData) -> Table:
    """Return the true body pitch [°]."""
    series = run.series[PLANT_IMU]
    return envelope(series.time, PITCH.columns(np.degrees(series.values[:, :2])))


def track_table(run: RunData) -> Table:
    """Return the track of the ball in ``map`` [cm]."""
    series = run.series[PLANT_ODOM]
    return every_nth(series.time, track_columns(series.values))


def duty_table(run: RunData) -> Table:
    """Return the duties [%]."""
    series = run.series[MOTOR_DUTY]
    return envelope(series.time, DUTY.columns(series.values[:, :2]))


def motion_table(run: RunData) -> Table:
    """Return position [cm] and body pitch [°] at ticks that have both."""
    position, pitch = position_table(run), pitch_table(run)
    if not np.array_equal(position['time_s'], pitch['time_s']):
        stamps = np.intersect1d(run.series[PLANT_ODOM].stamps, run.series[PLANT_IMU].stamps)
        odometry, body = run.series[PLANT_ODOM], run.series[PLANT_IMU]
        time = odometry.time[np.isin(odometry.stamps, stamps)]
        return envelope(
            time,
            POSITION.columns(odometry.at(stamps) * 100.0)
            | PITCH.columns(np.degrees(body.at(stamps)[:, :2])),
        )
    return {**position, **pitch}


def estimate_table(run: RunData) -> Table:
    """Return true and estimated pitch [°] and position [cm]."""
    body = run.series[PLANT_IMU]
    # Reduce one quantity after the other: for an hour, the ticks of all would take 60 MB.
    table = dict(_table(body, 'true_pitch', 'deg', np.degrees(body.values[:, :2])))
    table |= _table(body, 'estimated_pitch', 'deg', np.degrees(estimated_pitch(run, body.stamps)))
    table |= _table(body, 'true_position', 'cm', run.series[PLANT_ODOM].at(body.stamps) * 100.0)
    believed = estimated_position(run, body.stamps)
    table |= _table(body, 'estimated_position', 'cm', believed * 100.0)
    return table


def command_table(run: RunData) -> Table:
    """Return commanded, reference and true speed [cm/s], and reference and true position [cm].

    It is empty if the controller publishes no reference.
    """
    truth = run.series[PLANT_ODOM]
    stamps = truth.stamps
    reference = reference_speed(run, stamps)
    if np.isnan(reference).all():
        return {'time_s': np.zeros(0)}
    table = dict(_table(truth, 'reference_speed', 'cm_per_s', reference * 100.0))
    del reference  # reduce one quantity after the other, as in estimate_table
    table |= _table(truth, 'commanded_speed', 'cm_per_s', commanded_speed(run, stamps) * 100.0)
    table |= _table(truth, 'true_speed', 'cm_per_s', ball_speed(run) * 100.0)
    table |= _table(truth, 'reference_position', 'cm', reference_position(run, stamps) * 100.0)
    table |= _table(truth, 'true_position', 'cm', truth.values * 100.0)
    return table


def gyro_table(run: RunData) -> Table:
    """Return true rate, reading minus offset, true and estimated offset [°/s]."""
    gyro = run.series[GYRO_IMU]
    rates = run.series[PLANT_IMU].at(gyro.stamps)[:, 2:]
    table = dict(_table(gyro, 'true_rate', 'deg_per_s', np.degrees(rates)))
    offset = estimated_gyro_offset(run)
    table |= _table(gyro, 'read_rate', 'deg_per_s', np.degrees(gyro.values) - offset)
    table |= _table(gyro, 'true_offset', 'deg_per_s', true_gyro_offset(run))
    table |= _table(gyro, 'estimated_offset', 'deg_per_s', offset)
    return table


def sonar_table(run: RunData) -> Table:
    """Return the measured distances [cm]; infinite for no echo."""
    series = run.series[SONAR_RANGE]
    distance = series.values[:, 0].astype(float) * 100.0
    return every_nth(series.time, {'distance_cm': distance})


def sticks_table(run: RunData) -> Table:
    """Return the sticks [%], forward and rightward positive; empty if they are never moved."""
    series = run.series[GAMEPAD_JOY]
    sticks = np.rint(series.values * 100.0) + 0.0
    if not sticks.any():
        return {'time_s': np.zeros(0)}
    return _table(series, 'stick', 'percent', sticks)


def battery_table(run: RunData) -> Table:
    """Return the voltage [V]."""
    series = run.series[BATTERY_STATE]
    return envelope(series.time, {'voltage_v': series.values[:, 0]})


def utilisation_table(run: RunData) -> Table:
    """Return the utilisation of the processor [%] in each 100 ms; empty if tasks take no time."""
    parameters = run.attached.parameters.of(ControllerParameters)
    if run.jobs is None or not parameters.kernel:
        return {'time_s': np.zeros(0)}
    interrupt_us = kernel_constants(parameters).interrupt_us
    # The jobs after the last whole 100 ms are not recorded.
    edges_ms = np.arange(0, round((run.end + TICK_S) * 1e3) + 1, 100)
    edges = run.start_ns // 1000 + 1000 * edges_ms
    parts, bus = pieces(ended(run.jobs), interrupt_us), bus_share(parameters)
    shares = utilisation(parts, edges, bus, interrupt_us)
    return envelope(edges_ms[:-1] * 1e-3 + 0.05, {'utilisation_percent': 100.0 * shares})


def state_table(run: RunData) -> Table:
    """Return the operating states and their times [s]."""
    return {
        'start_s': np.array([each.start for each in run.states]),
        'end_s': np.array([each.end for each in run.states]),
        'state': np.array([each.name for each in run.states]),
    }
