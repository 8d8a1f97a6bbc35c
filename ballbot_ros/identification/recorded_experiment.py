"""The experiment in a recording: what a brick measured, or the truth of the plant."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ballbot_ros.analysis.run_data import RunData
from ballbot_ros.brick.battery_monitor import COUNT_V, battery_mv, count_of
from ballbot_ros.brick.dead_time import mean_delay
from ballbot_ros.identification.arrays import Floats
from ballbot_ros.identification.errors import IdentificationError
from ballbot_ros.identification.experiment import (
    ENCODER,
    GYRO,
    TRUE_PITCH,
    TRUE_PITCH_RATE,
    TRUE_POSITION,
    Channel,
    Experiment,
    with_values,
)
from ballbot_ros.messages.topics import (
    BATTERY_STATE,
    GYRO_IMU,
    JOINT_STATES,
    MOTOR_DUTY,
    PLANT_IMU,
    PLANT_ODOM,
    Topic,
)
from ballbot_ros.parameters import (
    DeviceParameters,
    EncoderParameters,
    GyroParameters,
    PlantParameters,
    Value,
)
from ballbot_ros.timing import STEPS_PER_TICK, TICK_NS, TICK_S

_AFTER_PUSH_S = 0.1


def recorded_experiment(
    run: RunData, known: Mapping[str, Value], *, truth: bool = False
) -> Experiment:
    """Return the experiment in a recorded run.

    Parameters
    ----------
    known : mapping
        Values of the plant that replace the recorded ones, by name.
    truth : bool
        Whether the plant's topics are used instead of the readings of the brick's devices.

    Raises
    ------
    IdentificationError
        If the recording lacks a topic, or was not made in lockstep.
    """
    if not run.plant.lockstep:
        raise IdentificationError(
            f'{run.path}: a free-running run does not tell when each duty acted; record one in '
            'lockstep'
        )
    ticks = _Ticks(run)
    recorded = run.plant if run.attached.has_parameters else None
    plant = _with_mean_delay(with_values(run.plant, known))
    notes = []
    duty = ticks.of(MOTOR_DUTY)
    battery = ticks.of(BATTERY_STATE)[:, 0]
    readings: dict[Channel, Floats]
    ages: dict[Channel, int] = {}
    if truth:
        imu = ticks.of(PLANT_IMU)
        readings = {
            TRUE_PITCH_RATE: np.degrees(imu[:, 2:4]),
            TRUE_PITCH: np.degrees(imu[:, :2]),
            TRUE_POSITION: ticks.of(PLANT_ODOM),
        }
        battery_count = 0.0
    else:
        readings = {
            GYRO: np.rint(np.degrees(ticks.of(GYRO_IMU))),
            ENCODER: np.rint(np.degrees(ticks.of(JOINT_STATES))),
        }
        ages = {
            GYRO: _age(run.attached.parameters.of(GyroParameters)),
            ENCODER: _age(run.attached.parameters.of(EncoderParameters)),
        }
        measured = ~np.isnan(battery)
        counts = [count_of(battery_mv(volts)) for volts in battery[measured].tolist()]
        battery[measured] = np.multiply(counts, COUNT_V)
        battery_count = COUNT_V
    usable = run.balancing(ticks.time) & ~np.isnan(duty).any(axis=1)
    for values in readings.values():
        usable &= ~np.isnan(values).any(axis=1)
    if scenario := run.attached.scenario:
        for push in scenario.pushes:
            end = push.time + push.duration + _AFTER_PUSH_S
            usable &= (ticks.time < push.time - TICK_S) | (ticks.time > end)
    if missing := ticks.missing:
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
        notes=tuple(notes),
        recorded=recorded,
    )


class _Ticks:
    """The ticks of a run, without gaps; where one is missing, its values are NaN."""

    def __init__(self, run: RunData) -> None:
        self._run = run
        duty = run.series.get(MOTOR_DUTY)
        if duty is None:
            raise _not_recorded(run, MOTOR_DUTY)
        self._first = int(duty.stamps[0])
        self._count = (int(duty.stamps[-1]) - self._first) // TICK_NS + 1
        begin = float(duty.time[0])
        self.time = np.asarray(begin + np.arange(self._count) * TICK_S, np.float64)
        self.missing = self._count - len(np.unique(self._numbers(duty.stamps)))

    def _numbers(self, stamps: NDArray[np.int64]) -> NDArray[np.int64]:
        return np.asarray((stamps - self._first) // TICK_NS)

    def of(self, topic: Topic) -> Floats:
        """Return the values of a topic, shape (n, k)."""
        series = self._run.series.get(topic)
        if series is None:
            raise _not_recorded(self._run, topic)
        values = np.full((self._count, series.values.shape[1]), np.nan)
        numbers = self._numbers(series.stamps)
        inside = (numbers >= 0) & (numbers < self._count)
        values[numbers[inside]] = series.values[inside]
        return values


def _not_recorded(run: RunData, topic: Topic) -> IdentificationError:
    return IdentificationError(f'{run.path}: topic {topic.name!r} was not recorded')


def _age(device: DeviceParameters) -> int:
    """Return the mean dead time of a device [physics steps]."""
    return round(mean_delay(device.delay, device.delay_jitter, STEPS_PER_TICK))


def _with_mean_delay(plant: PlantParameters) -> PlantParameters:
    delay = mean_delay(plant.actuator_delay, plant.actuator_delay_jitter, STEPS_PER_TICK)
    return replace(plant, actuator_delay=round(delay), actuator_delay_jitter=0)
