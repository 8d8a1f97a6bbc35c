"""The metrics of a run."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ballbot_ros.scenario.metrics import METRICS, SETTLED_DEG
from ballbot_ros.scenario.scenario import Expectation
from ballbot_ros.simulation.trajectory import Trajectory

Floats = NDArray[np.float64]
Clearance = Callable[[Floats], Floats]
"""Distances [m] from the body's outline to a wall at positions (n, 2) in plane signs."""

_HALF_TICK = 0.002
_CLEARANCE_STRIDE = 5


@dataclass(frozen=True)
class Judgement:
    """An expectation and the value that it met."""

    expectation: Expectation
    value: float

    @property
    def holds(self) -> bool:
        """Whether the value is within the bounds."""
        return self.expectation.holds(self.value)


def judge(
    expectations: Iterable[Expectation],
    trajectory: Trajectory,
    plant: Mapping[str, Any],
    clearance: Clearance | None = None,
) -> list[Judgement]:
    """Measure each expectation's metric in its window; for the arguments see :func:`measure`."""
    return [
        Judgement(
            each,
            measure(trajectory, plant, clearance, start=each.start, end=each.end)[each.metric],
        )
        for each in expectations
    ]


def measure(
    trajectory: Trajectory,
    plant: Mapping[str, Any],
    clearance: Clearance | None = None,
    *,
    start: float = 0.0,
    end: float = math.inf,
) -> dict[str, float]:
    """Return every metric of a run; NaN where there is nothing to measure it by.

    Parameters
    ----------
    trajectory : Trajectory
    plant : mapping
        The parameters of ``plant_sim``: start position, and release by ``hold_time``.
    clearance : callable or None
        Distances to the walls; None where there are none.
    start, end : float
        The window that is measured [s], from its start or the release to its end.
    """
    first = max(start, plant['hold_time'])
    within = (trajectory.time > first - _HALF_TICK) & (trajectory.time < end + _HALF_TICK)
    if not within.any():
        return dict.fromkeys(METRICS, math.nan)
    time = trajectory.time[within]
    pitch = np.degrees(trajectory.psi[within])
    position = trajectory.position[within]
    origin = np.array([plant['start_position_x'], plant['start_position_y']], dtype=float)
    offset = position - origin
    distance = np.hypot(offset[:, 0], offset[:, 1])
    steps = np.hypot(*np.diff(position, axis=0).T)
    duty = trajectory.duty[within].astype(float)
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
        steps.sum(),
        (steps / np.diff(time)).max(initial=0.0),
        _least(clearance, position),
        _rms(duty),
        np.mean(np.abs(duty) >= 100.0),
    )
    return dict(zip(METRICS, map(float, values), strict=True))


def _least(clearance: Clearance | None, position: Floats) -> float:
    if clearance is None:
        return math.nan
    return float(clearance(position[::_CLEARANCE_STRIDE]).min())


def _settling_time(time: np.ndarray, pitch: np.ndarray) -> float:
    """Return the time from the first row on after which no pitch leaves the band; NaN if never."""
    outside = np.flatnonzero(np.abs(pitch).max(axis=1) > SETTLED_DEG)
    if outside.size == 0:
        return 0.0
    last = outside[-1]
    return math.nan if last == len(time) - 1 else float(time[last + 1] - time[0])


def _rms(values: np.ndarray) -> float:
    return math.sqrt(float(np.mean(np.square(values))))
