"""Measurement of a run, and judgement by its expectations."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from ballbot_ros.parameters import PlantParameters
from ballbot_ros.scenario.metrics import METRICS, Clearance, Motion
from ballbot_ros.scenario.scenario import Expectation
from ballbot_ros.simulation.trajectory import Trajectory
from ballbot_ros.timing import TICK_S

HALF_TICK_S = TICK_S / 2.0
"""Tolerance for times of ticks, which are rounded, unlike stamps in whole nanoseconds [s]."""


@dataclass(frozen=True)
class Judgement:
    """An expectation and its measured value."""

    expectation: Expectation
    value: float

    @property
    def holds(self) -> bool:
        """Whether the value is within the bounds."""
        return self.expectation.holds(self.value)

    def __str__(self) -> str:
        """Return a text that says that the value is outside the bounds."""
        window = f' ({self.expectation.window})' if self.expectation.window else ''
        return f'{self.expectation.metric}{window} {self.value:.4g} is not {self.expectation}'

    def as_json(self) -> dict[str, object]:
        """Return metric, window, bounds and value; a missing number is None."""
        return {
            'metric': self.expectation.metric,
            'from': self.expectation.start,
            'to': number(self.expectation.end),
            'min': self.expectation.minimum,
            'max': self.expectation.maximum,
            'value': number(self.value),
        }


def number(value: float) -> float | None:
    """Return `value`, or None if it is not finite, since JSON has no NaN or infinity."""
    return value if math.isfinite(value) else None


def with_judgements(
    metrics: Mapping[str, float], judgements: Iterable[Judgement]
) -> Iterator[tuple[str, float, Judgement | None]]:
    """Yield each metric, its value, and the judgement of the whole run by it; then the windows'."""
    judgements = list(judgements)
    whole = {
        each.expectation.metric: each for each in judgements if each.expectation.covers_whole_run
    }
    for name, value in metrics.items():
        yield name, value, whole.get(name)
    for each in judgements:
        if not each.expectation.covers_whole_run:
            yield each.expectation.metric, each.value, each


def judge(
    expectations: Iterable[Expectation],
    trajectory: Trajectory,
    plant: PlantParameters,
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
    plant: PlantParameters,
    clearance: Clearance | None = None,
    *,
    start: float = 0.0,
    end: float = math.inf,
) -> dict[str, float]:
    """Return all metrics of a run; NaN if the data are missing.

    A trajectory column of NaN was not recorded; metrics that depend on it are NaN.

    Parameters
    ----------
    plant : PlantParameters
        The parameters of ``plant_sim``, for the start position and the release (``hold_time``).
    clearance : callable or None
        Returns the distances to the walls; None if there are no walls.
    start, end : float
        The measured window [s]; the part of it before the release is left out.
    """
    first = max(start, plant.hold_time)
    # A slice, not a mask: it copies nothing.
    within = slice(
        np.searchsorted(trajectory.time, first - HALF_TICK_S, side='right'),
        np.searchsorted(trajectory.time, end + HALF_TICK_S),
    )
    time = trajectory.time[within]
    if not len(time):
        return dict.fromkeys(METRICS, math.nan)
    motion = Motion(
        time=time,
        position=trajectory.position[within],
        psi=trajectory.psi[within],
        duty=trajectory.duty[within].astype(float),
        start=np.array([plant.start_position_x, plant.start_position_y], dtype=float),
        clearance=clearance,
    )
    return METRICS.measure(motion)
