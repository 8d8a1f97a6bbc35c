"""The columns of a study's results, and the metrics of many runs at once."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ballbot_ros.analysis.metrics import measured_window
from ballbot_ros.engine.rows import Column
from ballbot_ros.engine.scenario.metrics import METRICS, Motion, label, wall_clearance_m
from ballbot_ros.engine.scenario.properties import (
    Course,
    MissingSignalError,
    MotionSignals,
    Part,
    Property,
)
from ballbot_ros.engine.scenario.scenario import Expectation, Measure
from ballbot_ros.parameters.parameter import TextEnum
from ballbot_ros.robot.arithmetic import Floats


class ColumnKind(TextEnum):
    """What the values of a column are."""

    FLOAT = 'float64'
    INTEGER = 'int64'
    BOOLEAN = 'bool'
    TEXT = 'text'
    SHA256 = 'sha256'

    @classmethod
    def of(cls, values: Column) -> ColumnKind:
        """Return the kind of some values, which are no hashes."""
        kinds = {'f': cls.FLOAT, 'i': cls.INTEGER, 'u': cls.INTEGER, 'b': cls.BOOLEAN}
        return kinds.get(values.dtype.kind, cls.TEXT)


@dataclass(frozen=True)
class ResultColumn:
    """A column of the results.

    Attributes
    ----------
    name : str
        Name in the Parquet files.
    unit : str
        Empty for pure numbers, texts and truth values.
    """

    name: str
    kind: ColumnKind = ColumnKind.FLOAT
    unit: str = ''
    meaning: str = ''


@dataclass(frozen=True)
class MeasureColumn(ResultColumn):
    """A column of a measure's values, with the bounds that the study expects.

    A measure has no value if its window has no ticks, for example after a fall, or if it needs what
    the run lacks, such as walls.
    """

    minimum: float | None = None
    maximum: float | None = None

    @classmethod
    def of(
        cls, measure: Measure | Property, expectations: Iterable[Expectation] = ()
    ) -> MeasureColumn:
        """Return the column of a measure, with the bounds that some of the expectations set.

        That of a property has its robustness, which must not be negative.
        """
        if isinstance(measure, Property):
            text = f'robustness of {measure.text}'
            return cls(measure.name, ColumnKind.FLOAT, measure.unit, text, 0.0)
        bounds = [each for each in expectations if each.measure == measure]
        lower = [each.minimum for each in bounds if each.minimum is not None]
        upper = [each.maximum for each in bounds if each.maximum is not None]
        return cls(
            _measure_name(measure),
            ColumnKind.FLOAT,
            label(measure.metric)[1],
            METRICS[measure.metric].meaning,
            max(lower, default=None),
            min(upper, default=None),
        )

    def badness(self, values: Floats) -> Floats:
        """Return numbers that are the larger, the worse the values are; NaN remains NaN.

        The expectation decides which are the worst: with a minimum only, the smallest; with both
        bounds, the farthest from their middle; otherwise the largest. Without any, little clearance
        is the worst.
        """
        if self.minimum is not None and self.maximum is not None:
            return np.abs(values - (self.minimum + self.maximum) / 2)
        is_clearance = self.name.startswith(wall_clearance_m.__name__)
        wants_much = self.minimum is not None or (is_clearance and self.maximum is None)
        return -values if wants_much else values


NUMBER = ResultColumn('number', ColumnKind.INTEGER, meaning='number of the run, from 0')
SEED = ResultColumn('seed', ColumnKind.INTEGER, meaning="seed of the run's random numbers")
PASSED = ResultColumn('passed', ColumnKind.BOOLEAN, meaning='completed, and all expectations hold')
OUTCOME = ResultColumn('outcome', ColumnKind.TEXT, meaning='completed, or failed: ended by a fault')
FALLEN = ResultColumn('fallen', ColumnKind.BOOLEAN, meaning='the robot has fallen')
TICKS = ResultColumn('ticks', ColumnKind.INTEGER, meaning='number of ticks of the run')
DUTY_SHA256 = ResultColumn('duty_sha256', ColumnKind.SHA256, meaning='SHA-256 of the duties')

BEFORE = (NUMBER, SEED)
AFTER = (PASSED, OUTCOME, FALLEN, TICKS, DUTY_SHA256)


def _measure_name(measure: Measure) -> str:
    """Return the name of a measure's column: the metric's, with the window if there is one."""
    if measure.start == 0.0 and measure.end == math.inf:
        return measure.metric
    end = 'end' if measure.end == math.inf else _shortest(measure.end)
    return f'{measure.metric}[{_shortest(measure.start)},{end}]'


def _shortest(seconds: float) -> str:
    """Return a number as text that reads back exactly, so that no two windows share a name."""
    return repr(float(seconds)).removesuffix('.0')


def robustness_of(
    each: Property,
    signals: MotionSignals,
    hold_times: Sequence[float],
    ticks: Sequence[int],
    courses: Sequence[Course],
) -> Floats:
    """Return the robustness of a property in runs, (r,), given their numbers and courses.

    Runs with the same parts are evaluated together.
    """
    alike: dict[tuple[Part, ...], list[int]] = {}
    for run, numbers in enumerate(zip(hold_times, ticks, courses, strict=True)):
        alike.setdefault(tuple(each.parts(*numbers)), []).append(run)
    found = np.zeros(len(ticks))
    for parts, runs in alike.items():
        found[runs] = each.robustness(signals.of_runs(runs).values, parts)
    return found


OTHERS = (
    *('pitch_rate_x_deg_per_s', 'pitch_rate_y_deg_per_s', 'gyro_x_deg_per_s', 'gyro_y_deg_per_s'),
    *('encoder_x_deg', 'encoder_y_deg'),
)
"""Signals of studies that do not follow from the motion, as in `RunLog.others`."""


def other_signal(others: Floats, name: str) -> Floats:
    """Return one of :data:`OTHERS`, (r, n), from those of runs, with rates in rad/s."""
    if name not in OTHERS:
        raise MissingSignalError(name)
    values = others[..., OTHERS.index(name)]
    return np.asarray(np.degrees(values)) if name.startswith('pitch') else values


def metric(motion: Motion) -> float:
    """Raise NotImplementedError; the compiler calls a metric in place of this function."""
    raise NotImplementedError


def measure_runs(
    plants: Any,
    starts: Any,
    ends: Any,
    log: Any,
    time: Any,
    walls: Any,
    window_start: float,
    window_end: float,
    values: Any,
) -> None:
    """Measure a metric in a window of many runs; NaN if no tick is in the window.

    Parameters
    ----------
    plants : rows
        The parameters of ``plant_sim``.
    starts : ndarray, shape (r, 2)
        Start positions [m].
    ends : rows of robots
        How the runs ended.
    time : ndarray, shape (n,)
        Time of each tick since the first [s].
    walls : Walls
        As in :class:`~ballbot_ros.engine.scenario.metrics.Motion`.
    window_start, window_end : float
        The measured window [s].
    values : ndarray, shape (r,)
        Where the values are written.
    """
    for run in range(len(plants)):
        first, last = measured_window(
            time[: ends[run].ticks], plants[run].hold_time, window_start, window_end
        )
        if first >= last:
            values[run] = math.nan
            continue
        values[run] = metric(
            Motion(
                time[first:last],
                log.position[run, first:last],
                log.psi[run, first:last],
                log.duty[run, first:last],
                starts[run],
                walls,
                log.timing[run, first:last],
            )
        )
