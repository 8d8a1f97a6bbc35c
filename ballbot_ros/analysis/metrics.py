"""Measurement of a run, and judgement by its expectations."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ballbot_ros.analysis.figure_parts import Interval, IntervalKind
from ballbot_ros.engine.scenario.metrics import METRICS, Motion
from ballbot_ros.engine.scenario.properties import (
    Course,
    MissingSignalError,
    MotionSignals,
    Property,
)
from ballbot_ros.engine.scenario.scenario import Expectation, Measure
from ballbot_ros.engine.trajectory import Trajectory
from ballbot_ros.parameters import PlantParameters
from ballbot_ros.parameters.parameter import TextEnum
from ballbot_ros.parameters.timing import TICK_S
from ballbot_ros.robot.world.clearance import NO_WALLS, Walls


class Verdict(TextEnum):
    """Verdict on a run, as shown in reports, tables and JSON."""

    PASSED = 'passed'
    NOT_MET = 'expectations not met'
    FAILED = 'failed'
    STOPPED = 'stopped'
    CHANGED = 'changed'
    """All expectations are met, but somebody set parameters during the run."""
    INCOMPLETE = 'incomplete'
    """The recording lacks a part of the run."""
    NOT_JUDGED = 'not judged'
    """The recording lacks the data that the expectations need."""


class ExpectationVerdict(TextEnum):
    """Verdict on an expectation in a recorded run."""

    MET = 'met'
    NOT_MET = 'not met'
    NOT_JUDGED = 'not judged'
    """The recording lacks the data that the expectation needs."""


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
        value = 'without a value' if math.isnan(self.value) else f'{self.value:.4g}'
        return f'{self.expectation.metric}{window} {value} instead of {self.expectation}'

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


@dataclass(frozen=True)
class PropertyJudgement:
    """A property, and its robustness in a run.

    Attributes
    ----------
    robustness : float
        Infinite if the run has no time for which it is, NaN if it is undecided.
    moment : float
        When a signal decided it [s]; NaN if none did.
    lack : str
        Why it is undecided; otherwise ''.
    """

    of: Property
    robustness: float
    moment: float = math.nan
    lack: str = ''

    @property
    def holds(self) -> bool:
        """Whether it holds."""
        return self.robustness >= 0.0

    @property
    def outcome(self) -> str:
        """What decided it, as text."""
        if self.lack:
            return f'undecided: {self.lack}'
        if math.isnan(self.moment):
            return 'no time to judge' if self.holds else 'beyond the end'
        return 'from violation ' * self.holds + f'at {self.moment:.3f} s'

    @property
    def marks(self) -> tuple[Interval, ...]:
        """The moment, for figures."""
        if math.isnan(self.moment):
            return ()
        end, name = self.moment + TICK_S, self.of.name
        return (Interval(self.moment, end, name, IntervalKind.PROPERTY, str(self)),)

    def __str__(self) -> str:
        """Return name, robustness and what decided it."""
        value = f' {self.robustness:.4g} {self.of.unit}' * math.isfinite(self.robustness)
        return f'{self.of.name}{value.rstrip()} {self.outcome}'

    def as_json(self) -> dict[str, object]:
        """Return name, text, robustness, unit, moment and lack; a missing number is None."""
        return {
            'name': self.of.name,
            'text': self.of.text,
            'robustness': number(self.robustness),
            'unit': self.of.unit,
            'moment_s': number(self.moment),
            'undecided': self.lack,
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
    walls: Walls = NO_WALLS,
) -> list[Judgement]:
    """Measure each expectation's metric in its window; for the arguments see :func:`measure`."""
    return [
        Judgement(each, measure_one(each.measure, trajectory, plant, walls))
        for each in expectations
    ]


def judge_property(
    each: Property, signals: MotionSignals, plant: PlantParameters, course: Course
) -> PropertyJudgement:
    """Evaluate a property in a single run."""
    parts = each.parts(plant.hold_time, len(signals.time), course)
    try:
        robustness = float(each.robustness(signals.values, parts)[0])
        tick = each.decision(signals.values, parts)
    except MissingSignalError as error:
        return PropertyJudgement(each, math.nan, lack=str(error))
    lack = ''
    if math.isnan(robustness):
        lack = each.shortage(parts) or f'no value of {" or ".join(each.signals)}'
    moment = math.nan if tick is None else float(signals.time[tick])
    return PropertyJudgement(each, robustness, moment, lack)


def measure_one(
    measure: Measure, trajectory: Trajectory, plant: PlantParameters, walls: Walls = NO_WALLS
) -> float:
    """Return one metric of a run in a window; for the arguments see :func:`measure`."""
    motion = _motion(trajectory, plant, walls, measure.start, measure.end)
    return math.nan if motion is None else float(METRICS[measure.metric].compute(motion))


def measure(
    trajectory: Trajectory, plant: PlantParameters, walls: Walls = NO_WALLS
) -> dict[str, float]:
    """Return all metrics of a whole run; NaN if the data are missing.

    A trajectory column of NaN was not recorded; metrics that depend on it are NaN. Of the
    parameters of ``plant_sim``, start position and release (``hold_time``) are needed; the walls
    are those around the body, for its clearance.
    """
    motion = _motion(trajectory, plant, walls, 0.0, math.inf)
    return dict.fromkeys(METRICS, math.nan) if motion is None else METRICS.measure(motion)


def _motion(
    trajectory: Trajectory, plant: PlantParameters, walls: Walls, start: float, end: float
) -> Motion | None:
    """Return the motion in a window [s], from the release on; None if no tick is in it."""
    first, last = measured_window(trajectory.time, plant.hold_time, start, end)
    if first >= last:
        return None
    # Slices, not masks: they copy nothing.
    return Motion(
        time=trajectory.time[first:last],
        position=trajectory.position[first:last],
        psi=trajectory.psi[first:last],
        duty=trajectory.duty[first:last],
        start=np.array([plant.start_position_x, plant.start_position_y], dtype=float),
        walls=walls,
        timing=trajectory.timing[first:last],
    )


def measured_window(
    time: NDArray[np.float64], hold_time: float, start: float, end: float
) -> tuple[int, int]:
    """Return the first tick of the measured window, and the one behind its last.

    The function can be compiled by numba without changes.

    Parameters
    ----------
    time : ndarray, shape (n,)
        Time since the first tick of the run [s].
    hold_time : float
        The release [s]; the part of the window before it is left out.
    start, end : float
        The window [s], which includes both ends.
    """
    first = np.searchsorted(time, max(start, hold_time) - HALF_TICK_S, side='right')
    last = np.searchsorted(time, end + HALF_TICK_S)
    return int(first), int(last)
