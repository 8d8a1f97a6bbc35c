"""Charts of a tuning: its convergence, its path, and what it changes for the robots."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ballbot_ros.analysis.chart import Chart, Contour, ErrorBars, Layer, Scale, VerticalLine
from ballbot_ros.analysis.figure_parts import BLUE, GRAY, ORANGE, PAPER, Line, Table
from ballbot_ros.lab.search.objective import INFEASIBLE, Verdict
from ballbot_ros.lab.studies.report import value_text
from ballbot_ros.lab.studies.study_data import QUANTILES
from ballbot_ros.lab.studies.survey import with_unit
from ballbot_ros.lab.studies.variables import Levels, LogUniform, Variable, WholeNumbers
from ballbot_ros.robot.arithmetic import Floats

_START, _TUNED = Line(GRAY, 1.6, '--', 'start'), Line(BLUE, 1.8, label='tuned')
_BEST = Line(ORANGE, 2.0, label='best so far')

_WIDE = 20.0
"""Ratio of the largest to the smallest number from which an axis is logarithmic."""

_SHOWN_ROBOTS = 2000
"""Largest number of robots that a curve has one by one."""


class NamedChart(NamedTuple):
    """A chart with its numbers."""

    chart: Chart
    table: Table


def convergence_chart(verdicts: Verdict, population: int) -> NamedChart:
    """Return the cost over the candidates, without those that break a limit.

    If all do, it is by how much they break them.
    """
    is_any = bool(verdicts.is_feasible.any())
    costs = np.where(verdicts.is_feasible, verdicts.cost, np.nan)
    if not is_any:
        costs = verdicts.cost / INFEASIBLE - 1.0
    best = np.fmin.accumulate(costs)
    nothing = np.full(len(QUANTILES), np.nan)
    known = (row[~np.isnan(row)] for row in costs.reshape(-1, population))
    spread = np.array([np.quantile(each, QUANTILES) if each.size else nothing for each in known])
    label = 'cost' if is_any else 'limits exceeded by'
    scale = _scale_of(label, np.append(spread, best[population - 1 :]))
    return _progress(best, spread, population, scale)


def path_chart(variable: Variable, shares: Floats, costs: Floats, population: int) -> NamedChart:
    """Return the values of a parameter, and that of the best candidate, over the candidates.

    Each candidate has a share of the parameter's range and a cost, shape (n,).
    """
    of = variable.distribution
    values, words = of.values(shares), tuple[str, ...]()
    if isinstance(of, Levels) and values.dtype.kind not in 'fi':
        words = tuple(map(value_text, of.levels))
        values = np.array([of.levels.index(each) for each in values.tolist()])
    numbers = np.asarray(values, float)
    leaders = np.flatnonzero(np.append(True, np.diff(np.minimum.accumulate(costs)) < 0.0))
    best = numbers[leaders[np.searchsorted(leaders, np.arange(len(values)), 'right') - 1]]
    # Nearest, so that words stay words.
    spread = np.quantile(numbers.reshape(-1, population), QUANTILES, axis=1, method='nearest').T
    low, high = (-0.5, len(words) - 0.5) if words else of.ends
    is_log = isinstance(of.rounded if isinstance(of, WholeNumbers) else of, LogUniform)
    label = with_unit(_short(variable.name), variable.parameter.unit)
    scale = replace(_scale(label, low, high, is_log=is_log), words=words)
    return _progress(best, spread, population, scale)


def _progress(best: Floats, spread: Floats, population: int, scale: Scale) -> NamedChart:
    """Return the best so far, (n,), and the quantiles of each generation, (g, 5)."""
    count = population * np.arange(1.0, len(spread) + 1.0)
    low, *_, high = spread.T
    layers: list[Layer] = [
        ErrorBars(count, spread[:, 2], low, high, '', is_joined=True),
        Contour(np.stack([np.arange(1, len(best) + 1), best], axis=1), _BEST, PAPER),
    ]
    x = Scale('candidates', 0.0, 1.02 * float(count[-1]))
    quantiles = {
        f'quantile_{100.0 * share:g}_percent': column
        for share, column in zip(QUANTILES, spread.T, strict=True)
    }
    table = {'candidates': count, 'best': best[population - 1 :: population], **quantiles}
    return NamedChart(Chart(x, scale, layers), table)


def robots_chart(label: str, start: Floats, tuned: Floats) -> NamedChart:
    """Return which share of the robots is at least as bad as a value, for start and tuned values.

    The values, shape (r,), are what counts in the objective, the larger the worse; NaN is worse
    than any number.
    """
    curves = [_at_least_as_bad(each) for each in (start, tuned)]
    values, shares = np.concatenate(curves).T
    layers = [
        Contour(each, line, PAPER) for each, line in zip(curves, (_START, _TUNED), strict=True)
    ]
    x = _scale_of(label, values)
    y = Scale('robots at least as bad [%]', 0.8 * shares.min(initial=100.0), 120.0, is_log=True)
    table = {
        'values': np.repeat(['start', 'tuned'], list(map(len, curves))),
        'badness': values,
        'percent_at_least_as_bad': shares,
    }
    return NamedChart(Chart(x, y, layers), table)


def _at_least_as_bad(badness: Floats) -> Floats:
    """Return values, rising, and the share of robots at least as bad [%], (n, 2)."""
    known = np.sort(badness[~np.isnan(badness)])
    shares = 100.0 - 100.0 / len(badness) * np.arange(len(known))
    # All of the worst ones: there is what matters.
    rank = np.geomspace(1.0, max(1, len(known)), min(len(known), _SHOWN_ROBOTS)) - 1.0
    places = len(known) - 1 - np.unique(rank.astype(int))[::-1]
    return np.stack([known[places], shares[places]], axis=1)


def around_chart(
    name: str, changes: Floats, costs: Floats, best: float, all_costs: Floats
) -> NamedChart:
    """Return the cost over the change of a parameter.

    Parameters
    ----------
    changes, costs : ndarray, shape (s,)
        Changes as shares of the range, and their costs.
    best : float
        The cost without a change.
    all_costs : ndarray
        Those that the vertical axis has to show.
    """
    x, y = np.append(100.0 * changes, 0.0), np.append(costs, best)
    order = np.argsort(x, kind='stable')
    x, y = x[order], y[order]
    is_broken = y >= INFEASIBLE
    known = np.where(is_broken, np.nan, y)
    layers: list[Layer] = [
        *(VerticalLine(each, Line(ORANGE, 1.6, ':')) for each in x[is_broken].tolist()),
        Contour(np.stack([x, known], axis=1), Line(BLUE), PAPER),
        ErrorBars(x, known, known, known, '', is_joined=False),
    ]
    y_scale = _scale_of('cost', np.append(all_costs[all_costs < INFEASIBLE], best))
    table = {'change_percent': x, 'cost': known, 'breaks_a_limit': is_broken}
    x_scale = Scale(f'change of {_short(name)} [% of its range]', -11.0, 11.0)
    return NamedChart(Chart(x_scale, y_scale, layers), table)


def _short(name: str) -> str:
    """Return a parameter without its node, which is the controller's."""
    return name.partition('.')[2]


def _scale_of(label: str, values: Floats) -> Scale:
    """Return an axis that shows all numbers, logarithmic if they are of several magnitudes."""
    numbers = values[np.isfinite(values)]
    low, high = (float(numbers.min()), float(numbers.max())) if numbers.size else (0.0, 1.0)
    return _scale(label, low, high, is_log=low > 0.0 and high > _WIDE * low)


def _scale(label: str, low: float, high: float, *, is_log: bool) -> Scale:
    """Return an axis that is a little longer."""
    if is_log:
        return Scale(label, low / 1.15, 1.15 * high, is_log=True)
    room = 0.05 * (high - low) or 0.05 * abs(low) or 0.5
    return Scale(label, low - room, high + room)
