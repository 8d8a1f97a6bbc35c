"""The metrics of a run."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ballbot_ros.plant.truth import TICK_NS
from ballbot_ros.scenario.metrics import METRICS, SETTLED_DEG
from ballbot_ros.scenario.scenario import Expectation
from ballbot_ros.simulation.trajectory import Trajectory

Floats = NDArray[np.float64]
Clearance = Callable[[Floats], Floats]
"""Distances [m] from the body's outline to a wall at positions (n, 2) in plane signs."""

HALF_TICK_S = TICK_NS * 0.5e-9
"""Stamps are whole nanoseconds, times in seconds are rounded: so near they are the same tick."""

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

    def __str__(self) -> str:
        """Return in words that the value is not within the bounds."""
        window = f' ({self.expectation.window})' if self.expectation.window else ''
        return f'{self.expectation.metric}{window} {self.value:.4g} is not {self.expectation}'

    def as_json(self) -> dict[str, Any]:
        """Return metric, window, bounds and value; a number that is not there is None."""
        return {
            'metric': self.expectation.metric,
            'from': self.expectation.start,
            'to': number(self.expectation.end),
            'min': self.expectation.minimum,
            'max': self.expectation.maximum,
            'value': number(self.value),
        }


def number(value: float) -> float | None:
    """Return a finite number, None for any other, which JSON has not."""
    return value if math.isfinite(value) else None


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

    A column of the trajectory that is NaN throughout was not recorded: what depends on it is NaN.

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
    # A slice, not a mask: it copies nothing.
    within = slice(
        np.searchsorted(trajectory.time, first - HALF_TICK_S, side='right'),
        np.searchsorted(trajectory.time, end + HALF_TICK_S),
    )
    time = trajectory.time[within]
    if not len(time):
        return dict.fromkeys(METRICS, math.nan)
    # Its own half of the run: the transient has died away by then.
    late = slice(np.searchsorted(time, (time[0] + time[-1]) / 2.0), None)
    position = trajectory.position[within]
    values = (
        *_pitch_metrics(time, trajectory.psi[within], late),
        *_position_metrics(time, position, plant, late),
        _least(clearance, position),
        *_duty_metrics(trajectory.duty[within]),
    )
    return dict(zip(METRICS, map(float, values), strict=True))


def _pitch_metrics(time: Floats, psi: Floats, late: slice) -> tuple[float, ...]:
    pitch = np.degrees(psi)
    return _settling_time(time, pitch), np.abs(pitch).max(), _rms(pitch[late])


def _position_metrics(
    time: Floats, position: Floats, plant: Mapping[str, Any], late: slice
) -> tuple[float, ...]:
    origin = np.array([plant['start_position_x'], plant['start_position_y']], dtype=float)
    distance = _length(position - origin)
    steps = _length(np.diff(position, axis=0))
    from_mean = _length(position[late] - position[late].mean(axis=0))
    final = position[-1] - origin
    return (
        _rms(distance),
        distance.max(),
        _overshoot(position),
        _rms(from_mean),
        from_mean.max(),
        final[0],
        final[1],
        steps.sum(),
        (steps / np.diff(time)).max(initial=0.0),
    )


def _duty_metrics(duty: np.ndarray) -> tuple[float, ...]:
    duty = duty.astype(float)
    saturated = np.where(np.isnan(duty), math.nan, np.abs(duty) >= 100.0)
    return _rms(duty), saturated.mean()


def _length(vectors: Floats) -> Floats:
    return np.hypot(vectors[:, 0], vectors[:, 1])


def _least(clearance: Clearance | None, position: Floats) -> float:
    if clearance is None:
        return math.nan
    return float(clearance(position[::_CLEARANCE_STRIDE]).min())


def _settling_time(time: np.ndarray, pitch: np.ndarray) -> float:
    """Return the time from the first row on after which no pitch leaves the band; NaN if never."""
    outside = np.flatnonzero(np.abs(pitch).max(axis=1) > SETTLED_DEG)
    if np.isnan(pitch).any():
        return math.nan
    if outside.size == 0:
        return 0.0
    last = outside[-1]
    return math.nan if last == len(time) - 1 else float(time[last + 1] - time[0])


def _overshoot(position: Floats) -> float:
    """Return how far [m] the way goes beyond its end, seen from where it was farthest from it.

    Driving to a place and staying, that is the start; swinging back to the start, the turn.
    """
    beyond = position - position[-1]
    distance = _length(beyond)
    farthest = int(np.argmax(distance))
    if not distance[farthest]:
        return 0.0
    direction = -beyond[farthest] / distance[farthest]
    return float((beyond[farthest:] @ direction).max())


def _rms(values: np.ndarray) -> float:
    return math.sqrt(float(np.mean(np.square(values))))
