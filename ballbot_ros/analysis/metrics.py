"""The metrics of a run."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from ballbot_ros.scenario.metrics import METRICS, SETTLED_DEG
from ballbot_ros.simulation.trajectory import Trajectory


def measure(trajectory: Trajectory, plant: Mapping[str, Any]) -> dict[str, float]:
    """Return every metric of a run; NaN where the run was too short for it.

    Parameters
    ----------
    trajectory : Trajectory
    plant : mapping
        The parameters of ``plant_sim``: the release follows from ``hold_time``.
    """
    released = trajectory.time >= plant['hold_time'] - 1e-9
    if not released.any():
        return dict.fromkeys(METRICS, math.nan)
    time = trajectory.time[released]
    pitch = np.degrees(trajectory.psi[released])
    start = np.array([plant['start_position_x'], plant['start_position_y']], dtype=float)
    offset = trajectory.position[released] - start
    distance = np.hypot(offset[:, 0], offset[:, 1])
    duty = trajectory.duty[released].astype(float)
    # Its own half of the run: the transient has died away by then.
    late = pitch[time >= (time[0] + time[-1]) / 2.0]
    values = (
        _settling_time(time, pitch),
        np.abs(pitch).max(),
        _rms(late),
        _rms(distance),
        distance.max(),
        offset[-1, 0],
        offset[-1, 1],
        _rms(duty),
        np.mean(np.abs(duty) >= 100.0),
    )
    return dict(zip(METRICS, map(float, values), strict=True))


def _settling_time(time: np.ndarray, pitch: np.ndarray) -> float:
    """Return the time from the first row on after which no pitch leaves the band; NaN if never."""
    outside = np.flatnonzero(np.abs(pitch).max(axis=1) > SETTLED_DEG)
    if outside.size == 0:
        return 0.0
    last = outside[-1]
    return math.nan if last == len(time) - 1 else float(time[last + 1] - time[0])


def _rms(values: np.ndarray) -> float:
    return math.sqrt(float(np.mean(np.square(values))))
