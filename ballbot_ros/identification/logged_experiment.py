"""The experiment in a data log of the brick: ten records a second, without duties."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ballbot_ros.brick.bluetooth import LogPacket
from ballbot_ros.identification.arrays import Floats
from ballbot_ros.identification.errors import IdentificationError
from ballbot_ros.identification.experiment import (
    LOGGED_ENCODER,
    LOGGED_PITCH,
    Experiment,
    with_values,
)
from ballbot_ros.parameters import ControllerParameters, PlantParameters, Value
from ballbot_ros.teleop.csv_log import CLOCK_PERIOD_MS, read_csv_log
from ballbot_ros.timing import TICK_MS

NO_DUTIES = (
    'A data log has no duties. It tells something of body and ball, but nothing of motors, dead '
    'zone and battery.'
)

MAX_STEP_MS = TICK_MS
"""Longest step of the simulation between two records [ms]."""

SHORTEST_PERIOD_MS = 80
"""Shortest time between records [ms]. Of a log with more, only some are used: the motor voltages
between them are unknowns."""

LONGEST_PERIOD_MS = 255 * TICK_MS
"""Longest time between records [ms], that of the largest `log_count`."""

_JITTER = 0.1
_FALLEN_DEG = 30.0
"""Pitch from which the robot cannot be saved. The range of the log ends at 32 degrees."""


def logged_experiment(path: Path, known: Mapping[str, Value]) -> Experiment:
    """Return the experiment in a data log, which begins where the robot starts to move.

    Parameters
    ----------
    known : mapping
        Values of the plant by name; the document's for those that are missing.

    Raises
    ------
    TeleopError
        If the file is not a data log.
    IdentificationError
        If it has fewer than two records, or they are too far apart.
    """
    packets = read_csv_log(path)
    if len(packets) < 2:
        raise IdentificationError(f'{path}: has {len(packets)} records; at least 2 are needed')
    period, gaps = _steps(packets)
    if period > LONGEST_PERIOD_MS:
        raise IdentificationError(
            f'{path}: its records are {period} ms apart; those of a brick are at most '
            f'{LONGEST_PERIOD_MS} ms'
        )
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
    plant = with_values(PlantParameters(), known)
    pitch, shaft = _readings(packets)
    # In a gap, one missing record separates those before from those after.
    usable = np.insert(_usable(pitch, shaft), gaps, False)
    pitch, shaft = (np.insert(each, gaps, np.nan, axis=0) for each in (pitch, shaft))
    wheel = _wheel(shaft, math.degrees(plant.backlash) / 2.0)
    notes = [NO_DUTIES]
    if gaps.size:
        noun = 'gap' if gaps.size == 1 else 'gaps'
        notes.append(f'{gaps.size} {noun} between records: no segment crosses one.')
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


def _steps(packets: Sequence[LogPacket]) -> tuple[int, NDArray[np.intp]]:
    """Return the usual time between records [ms], and the numbers of the records after gaps."""
    times = np.array([each.time_ms for each in packets])
    intervals = np.diff(times) % CLOCK_PERIOD_MS
    period = int(np.median(intervals))
    return period, np.flatnonzero(np.abs(intervals - period) > _JITTER * period) + 1


def _readings(packets: Sequence[LogPacket]) -> tuple[Floats, Floats]:
    """Return pitch and shaft angle [deg] of both planes, shape (n, 2)."""
    lsb = ControllerParameters().lsb
    pitch = np.array([(each.adc1, each.adc2) for each in packets]) * lsb
    return pitch, np.array([(each.rev_b, each.rev_c) for each in packets], np.float64)


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
