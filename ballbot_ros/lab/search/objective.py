"""What a tuning is for: one number for each candidate, from the runs of many robots."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ballbot_ros.engine.rows import Column
from ballbot_ros.engine.scenario.scenario import bounds_text
from ballbot_ros.lab.studies.columns import FALLEN, OUTCOME, MeasureColumn
from ballbot_ros.robot.arithmetic import Floats

DEAD_TIME_MARGIN = 'dead_time_margin_ms'
"""A limit that is no measure of runs: the dead time that the loop bears beyond its own.

It holds for the document's program, whose loop can be analysed; others are not limited by it.
"""

MEAN, WORST = 'mean', 'worst'

INFEASIBLE = 1e100
"""Cost from which on a candidate breaks a limit; such ones are compared by how far they do."""


@dataclass(frozen=True)
class Limit:
    """A bound that a candidate must keep.

    It is one of a measure, over the runs as the objective is, or of :data:`DEAD_TIME_MARGIN`.
    """

    name: str
    minimum: float | None = None
    maximum: float | None = None

    def __str__(self) -> str:
        """Return the bound in words."""
        return bounds_text(self.minimum, self.maximum)

    def excess(self, values: Floats) -> Floats:
        """Return by how much values break the limit, relative to it; 0 if they keep it."""
        excess: Floats = np.zeros(len(values))
        for bound, sign in ((self.minimum, -1.0), (self.maximum, 1.0)):
            if bound is not None:
                with np.errstate(over='ignore'):
                    beyond = sign * (values - bound) / (abs(bound) or 1.0)
                excess += np.where(np.isnan(beyond), math.inf, np.maximum(0.0, beyond))
        return np.minimum(excess, 1e3)


class Verdict(NamedTuple):
    """What is known of candidates, (n,) each.

    Attributes
    ----------
    cost : ndarray
        The lower, the better; from :data:`INFEASIBLE` on a limit is broken.
    value : ndarray
        The objective over the runs that have a value; NaN without any.
    lost : ndarray
        Share of the runs without a value: the robot fell, the run failed, or a measure has none.
    limits : ndarray, shape (n, l)
        The values of the limits.
    """

    cost: Floats
    value: Floats
    lost: Floats
    limits: Floats

    @property
    def is_feasible(self) -> Column:
        """Whether they keep all limits."""
        return self.cost < INFEASIBLE


@dataclass(frozen=True)
class Objective:
    """A weighted sum of measures of a run, over all runs.

    Attributes
    ----------
    weights : mapping of str to float
        By measure. What is good if it is large, such as a robustness, counts with the other sign.
    share : float or None
        Quantile over the runs: 1 for the worst; None for the mean.
    """

    weights: Mapping[str, float]
    share: float | None
    limits: tuple[Limit, ...]

    @property
    def over(self) -> str:
        """How it is taken over the runs, in words."""
        if self.share is None:
            return MEAN
        return WORST if self.share == 1.0 else f'{100 * self.share:g} % quantile'

    @property
    def tolerated(self) -> float:
        """Share of the runs that may have no value."""
        return 0.0 if self.share is None else round(1.0 - self.share, 9)  # 1 - 0.9 < 0.1

    def judge(
        self,
        measures: Sequence[MeasureColumn],
        columns: Mapping[str, Column],
        margins: Floats | None = None,
    ) -> Verdict:
        """Judge candidates.

        Parameters
        ----------
        columns : mapping of str to ndarray
            Columns of the results, (n, r) each: a row for each candidate.
        margins : ndarray, shape (n,), optional
            The dead-time margins [ms], if there is a limit for them.
        """
        known = {each.name: each for each in measures}
        gone = columns[FALLEN.name] | columns[OUTCOME.name]
        values = np.zeros(gone.shape)
        with np.errstate(over='ignore', invalid='ignore'):
            for name, weight in self.weights.items():
                values = values + weight * known[name].badness(columns[name])
        values = np.where(gone | ~(np.abs(values) < INFEASIBLE), np.nan, values)
        is_lost = np.isnan(values)
        lost = is_lost.mean(axis=1)
        kept = np.array([
            margins if each.name == DEAD_TIME_MARGIN else self._over(known[each.name], columns)
            for each in self.limits
        ]).reshape(len(self.limits), len(values))  # fmt: skip
        excess = np.maximum(0.0, lost - self.tolerated)
        for each, found in zip(self.limits, kept, strict=True):
            excess = excess + each.excess(found)
        value = _over_runs(values, self.share)
        cost = np.where(excess > 0.0, INFEASIBLE * (1.0 + excess), value)
        return Verdict(cost, value, lost, kept.T)

    def broken(self, verdict: Verdict, number: int) -> list[str]:
        """Return which limits a candidate breaks, and by how much, in words."""
        found = [
            f'{each.name} is {value:.4g} instead of {each}, {_percent(excess)} off'
            for each, value in zip(self.limits, verdict.limits[number].tolist(), strict=True)
            if (excess := each.excess(np.array([value])).item()) > 0.0
        ]
        if (lost := verdict.lost[number]) > self.tolerated:
            found.append(
                f'{100.0 * lost:.3g} % of the robots fall, fail or lack a measure instead of at '
                f'most {100.0 * self.tolerated:.3g} %'
            )
        return found

    def _over(self, column: MeasureColumn, columns: Mapping[str, Column]) -> Floats:
        """Return a limited measure over the runs: its bad values count for a quantile."""
        values = np.asarray(columns[column.name], float)
        limit = next(each for each in self.limits if each.name == column.name)
        sign = 1.0 if limit.maximum is not None else -1.0
        return sign * _over_runs(sign * values, self.share)


def _percent(share: float) -> str:
    return f'{100.0 * share:,.0f} %' if share > 1.0 else f'{100.0 * share:.3g} %'


def _over_runs(values: Floats, share: float | None) -> Floats:
    """Return the mean of each row of values, or the quantile, for which NaN is the worst; (n,)."""
    found = np.full(len(values), math.nan)
    for number, row in enumerate(values):
        some = np.sort(row[~np.isnan(row)])
        if some.size:
            place = 0 if share is None else min(math.ceil(share * (len(row) - 1)), len(some) - 1)
            found[number] = some.mean() if share is None else some[place]
    return found
