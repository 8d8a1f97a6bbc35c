"""The columns of a study's results."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ballbot_ros.engine.scenario.metrics import METRICS, label, wall_clearance_m
from ballbot_ros.engine.scenario.scenario import Expectation, Measure
from ballbot_ros.parameters.text_enum import TextEnum

Floats = NDArray[np.float64]


class ColumnKind(TextEnum):
    """What the values of a column are."""

    FLOAT = 'float64'
    INTEGER = 'int64'
    BOOLEAN = 'bool'
    TEXT = 'text'
    SHA256 = 'sha256'

    @classmethod
    def of(cls, values: NDArray[Any]) -> ColumnKind:
        """Return the kind of some values, which are no hashes."""
        kinds = {'f': cls.FLOAT, 'i': cls.INTEGER, 'u': cls.INTEGER, 'b': cls.BOOLEAN}
        return kinds.get(values.dtype.kind, cls.TEXT)


class Worst(TextEnum):
    """Which value of a measure is the worst."""

    LARGEST = 'largest'
    SMALLEST = 'smallest'
    FARTHEST = 'farthest'
    """The farthest from the middle of the bounds."""


@dataclass(frozen=True)
class ResultColumn:
    """A column of the results.

    Attributes
    ----------
    name : str
        Name in the Parquet files.
    kind : ColumnKind
    unit : str
        Empty for pure numbers, texts and truth values.
    meaning : str
        A line for people.
    """

    name: str
    kind: ColumnKind = ColumnKind.FLOAT
    unit: str = ''
    meaning: str = ''


@dataclass(frozen=True)
class MeasureColumn(ResultColumn):
    """A column of a measure's values.

    A measure has no value if its window has no ticks, for example after a fall, or if it needs what
    the run lacks, such as walls.

    Attributes
    ----------
    minimum, maximum : float or None
        The bounds that the study expects.
    """

    minimum: float | None = None
    maximum: float | None = None

    @classmethod
    def of(cls, measure: Measure, expectations: Iterable[Expectation] = ()) -> MeasureColumn:
        """Return the column of a measure, with the bounds that some of the expectations set."""
        bounds = [each for each in expectations if each.measure == measure]
        lower = [each.minimum for each in bounds if each.minimum is not None]
        upper = [each.maximum for each in bounds if each.maximum is not None]
        return cls(
            measure_name(measure),
            ColumnKind.FLOAT,
            label(measure.metric)[1],
            METRICS[measure.metric].meaning,
            max(lower, default=None),
            min(upper, default=None),
        )

    @property
    def worst(self) -> Worst:
        """Which value is the worst.

        The expectation decides: with a minimum only, the smallest; with both bounds, the farthest
        from their middle; otherwise the largest. Without any, little clearance is the worst.
        """
        if self.minimum is not None:
            return Worst.SMALLEST if self.maximum is None else Worst.FARTHEST
        if self.maximum is None and self.name.startswith(wall_clearance_m.__name__):
            return Worst.SMALLEST
        return Worst.LARGEST

    def badness(self, values: Floats) -> Floats:
        """Return numbers that are the larger, the worse the values are; NaN remains NaN."""
        if self.minimum is not None and self.maximum is not None:
            return np.abs(values - (self.minimum + self.maximum) / 2)
        return -values if self.worst == Worst.SMALLEST else values


NUMBER = ResultColumn('number', ColumnKind.INTEGER, meaning='number of the run, from 0')
SEED = ResultColumn('seed', ColumnKind.INTEGER, meaning="seed of the run's random numbers")
PASSED = ResultColumn('passed', ColumnKind.BOOLEAN, meaning='completed, and all expectations hold')
OUTCOME = ResultColumn('outcome', ColumnKind.TEXT, meaning='completed, or failed: ended by a fault')
FALLEN = ResultColumn('fallen', ColumnKind.BOOLEAN, meaning='the robot has fallen')
TICKS = ResultColumn('ticks', ColumnKind.INTEGER, meaning='number of ticks of the run')
DUTY_SHA256 = ResultColumn('duty_sha256', ColumnKind.SHA256, meaning='SHA-256 of the duties')

BEFORE = (NUMBER, SEED)
AFTER = (PASSED, OUTCOME, FALLEN, TICKS, DUTY_SHA256)


def measure_name(measure: Measure) -> str:
    """Return the name of a measure's column: the metric's, with the window if there is one."""
    if measure.start == 0.0 and measure.end == math.inf:
        return measure.metric
    end = 'end' if measure.end == math.inf else _shortest(measure.end)
    return f'{measure.metric}[{_shortest(measure.start)},{end}]'


def _shortest(seconds: float) -> str:
    """Return a number as text that reads back exactly, so that no two windows share a name."""
    return repr(float(seconds)).removesuffix('.0')
