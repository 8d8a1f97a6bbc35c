"""The signals of a recorded run by name, at any ticks."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cache
from typing import TYPE_CHECKING

import numpy as np

from ballbot_ros.analysis.figure_parts import plane_columns
from ballbot_ros.analysis.run_data import Integers, RunData
from ballbot_ros.analysis.run_metrics import (
    ball_speed,
    commanded_speed,
    estimated_gyro_offset,
    estimated_pitch,
    estimated_position,
    reference_position,
    reference_speed,
)
from ballbot_ros.engine.scenario.properties import MissingSignalError, MotionSignals
from ballbot_ros.engine.trajectory import Trajectory
from ballbot_ros.errors import importing
from ballbot_ros.parameters.timing import SECOND_NS
from ballbot_ros.recording.messages.topics import (
    BATTERY_STATE,
    CONTROLLER_STATE,
    GAMEPAD_JOY,
    GYRO_IMU,
    JOINT_STATES,
    MOTOR_DUTY,
    PLANT_IMU,
    PLANT_JOINT_STATES,
    PLANT_ODOM,
    SONAR_RANGE,
    Topic,
)
from ballbot_ros.robot.arithmetic import Floats
from ballbot_ros.robot.world.clearance import Walls

if TYPE_CHECKING:
    import pandas

Columns = Mapping[str, Floats]


@dataclass(frozen=True)
class Signal:
    """A signal of a run, for both planes or without a plane.

    Attributes
    ----------
    name, unit : str
        They make the names of its columns, such as ``pitch_x_deg``.
    values : callable
        Returns the values at stamps [ns], shape (n, 2) for both planes, else (n, 1).
    needs : tuple of Topic
        The topics from which it comes.
    """

    name: str
    unit: str
    values: Callable[[RunData, Integers], Floats]
    needs: tuple[Topic, ...]
    has_planes: bool = True

    @property
    def columns(self) -> tuple[str, ...]:
        """The names of its columns."""
        if not self.has_planes:
            return (f'{self.name}_{self.unit}',)
        return tuple(plane_columns(self.name, self.unit, np.zeros((0, 2))))

    def table(self, run: RunData, stamps: Integers) -> Columns:
        """Return its columns at `stamps` [ns] by name; NaN where there is no sample."""
        return dict(zip(self.columns, self.values(run, stamps).T, strict=True))


def signals_of(run: RunData) -> list[Signal]:
    """Return the signals for which the run has the topics, in the order of :data:`SIGNALS`."""
    return [signal for signal in SIGNALS if run.series.keys() >= set(signal.needs)]


def motion_signals(
    trajectory: Trajectory, walls: Walls, read: Callable[[], RunData | None]
) -> MotionSignals:
    """Return the signals of a single run for properties.

    `read` returns what was recorded of it, or None. It is called only for signals that the
    trajectory lacks.
    """
    known = cache(read)

    def other(name: str) -> Floats:
        run = known()
        if run is None:
            raise MissingSignalError(f'{name} needs a recording')
        stamps = run.start_ns + np.rint(trajectory.time * SECOND_NS).astype(np.int64)
        for signal in signals_of(run):
            if name in signal.columns:
                return signal.table(run, stamps)[name][None]
        raise MissingSignalError(f'{name} was not recorded')

    position, psi, duty = trajectory.position, trajectory.psi, trajectory.duty
    return MotionSignals(trajectory.time, position[None], psi[None], duty[None], other, walls)


def _sampled(
    name: str,
    unit: str,
    topic: Topic,
    columns: slice = slice(2),
    convert: Callable[[Floats], Floats] = np.asarray,
    *,
    is_held: bool = False,
) -> Signal:
    """Return the signal in columns of a topic, whose newest value counts if it `is_held`."""

    def values(run: RunData, stamps: Integers) -> Floats:
        samples = run.series[topic].held(stamps) if is_held else run.samples(topic, stamps)
        return np.asarray(convert(samples[:, columns]))

    return Signal(name, unit, values, (topic,), has_planes=columns != slice(1))


def _whole_degrees(radians: Floats) -> Floats:
    """Return a reading of the brick, which counts in degrees."""
    return np.asarray(np.rint(np.degrees(radians)))


def _speed(run: RunData, stamps: Integers) -> Floats:
    return replace(run.series[PLANT_ODOM], values=ball_speed(run)).at(stamps)


def _duty(run: RunData, stamps: Integers) -> Floats:
    if not run.plant.lockstep:
        return run.series[MOTOR_DUTY].held(stamps)[:, :2]
    return run.samples(MOTOR_DUTY, stamps)[:, :2]


def _gyro_offset(run: RunData, stamps: Integers) -> Floats:
    return replace(run.series[GYRO_IMU], values=estimated_gyro_offset(run)).at(stamps)


def _estimated_pitch(run: RunData, stamps: Integers) -> Floats:
    return np.asarray(np.degrees(estimated_pitch(run, stamps)))


_SECOND_PAIR = slice(2, 4)
_CONTROLLER = (CONTROLLER_STATE,)

SIGNALS = (
    _sampled('position', 'm', PLANT_ODOM),
    Signal('speed', 'm_per_s', _speed, (PLANT_ODOM,)),
    _sampled('pitch', 'deg', PLANT_IMU, convert=np.degrees),
    _sampled('pitch_rate', 'deg_per_s', PLANT_IMU, _SECOND_PAIR, np.degrees),
    _sampled('motor_rate', 'deg_per_s', PLANT_JOINT_STATES, convert=np.degrees),
    _sampled('motor_torque', 'n_m', PLANT_JOINT_STATES, _SECOND_PAIR),
    Signal('duty', 'percent', _duty, (MOTOR_DUTY,)),
    _sampled('gyro', 'deg_per_s', GYRO_IMU, convert=_whole_degrees),
    _sampled('encoder', 'deg', JOINT_STATES, convert=_whole_degrees),
    _sampled('distance', 'm', SONAR_RANGE, slice(1), is_held=True),
    _sampled('battery', 'v', BATTERY_STATE, slice(1), is_held=True),
    _sampled('stick', 'percent', GAMEPAD_JOY, convert=lambda share: share * 100.0, is_held=True),
    Signal('estimated_position', 'm', estimated_position, _CONTROLLER),
    Signal('estimated_pitch', 'deg', _estimated_pitch, _CONTROLLER),
    Signal('estimated_gyro_offset', 'deg_per_s', _gyro_offset, (GYRO_IMU, CONTROLLER_STATE)),
    Signal('reference_position', 'm', reference_position, _CONTROLLER),
    Signal('reference_speed', 'm_per_s', reference_speed, _CONTROLLER),
    Signal('commanded_speed', 'm_per_s', commanded_speed, _CONTROLLER),
)
"""The signals of a run: true motion, duty, readings of the devices, sticks, and what the controller
estimates and follows. Signs are those of the planes."""


def frame_of(run: RunData) -> pandas.DataFrame:
    """Return the signals of a run, one row per tick; the index is the time since the start [s].

    Position, speed, body pitch, motor rate and torque are the true ones; `gyro` includes its
    offset. A signal without a sample at a tick is NaN. Signals that are sampled less often than the
    plant (distance, battery voltage, sticks, and in free-running mode the duty) keep their newest
    value. A real robot has a row per packet.

    Raises
    ------
    BallbotError
        If pandas is not installed.
    """
    with importing('pandas'):
        import pandas
    ticks = next(run.series[t] for t in (PLANT_IMU, PLANT_ODOM, *run.series) if t in run.series)
    columns: dict[str, Floats] = {}
    for signal in signals_of(run):
        columns |= signal.table(run, ticks.stamps)
    time = pandas.Index((ticks.stamps - run.start_ns) / SECOND_NS, name='time_s')
    frame = pandas.DataFrame(columns, index=time, dtype=float)
    states = np.full(len(ticks.time), None, dtype=object)  # None if it is unknown
    for each in run.states:
        states[(ticks.time >= each.start - 1e-9) & (ticks.time < each.end - 1e-9)] = each.name
    frame['operating_state'] = pandas.Categorical(states)
    return frame
