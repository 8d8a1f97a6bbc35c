"""Charts of a study: distributions, the share that passed over a variable, and sensitivities."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ballbot_ros.analysis.chart import (
    Bars,
    Chart,
    ChartFigure,
    ErrorBars,
    HeatMap,
    Layer,
    Scale,
    VerticalLine,
)
from ballbot_ros.analysis.figure_parts import BLUE, GRAY, INK, ORANGE, WIDTH, Line, Table
from ballbot_ros.lab.studies.columns import MeasureColumn
from ballbot_ros.lab.studies.maps import PANEL_WIDTH, scale_of
from ballbot_ros.lab.studies.sensitivity import Sensitivity
from ballbot_ros.lab.studies.study_data import QUANTILES, MeasureSummary, wilson_interval
from ballbot_ros.lab.studies.survey import Axis, CellCounts, Extent, with_unit
from ballbot_ros.robot.arithmetic import Floats

HISTOGRAM_BINS = 40

RUNS_PER_BIN = 100
"""Mean number of runs in a bin of a single variable."""

LEAST_BINS, MOST_BINS = 4, 25

_CORE = (0.02, 0.98)
"""Quantiles between which the values are that a histogram must show."""

_FAR = 4.0
"""How much wider than its core a distribution may be to be shown as a whole."""


def share_bins(runs: int) -> int:
    """Return the number of bins of a single variable over so many runs."""
    return int(np.clip(runs // RUNS_PER_BIN, LEAST_BINS, MOST_BINS))


def histogram_edges(column: MeasureColumn, extent: Extent, sample: Floats) -> Floats:
    """Return edges of a histogram that shows the core of a measure, and bounds near to it.

    The sample, shape (r,), has the values of some runs; those that are NaN or infinite do not
    count.
    """
    low, high = extent.low, extent.high
    known = sample[np.isfinite(sample)]
    if not low <= high or not known.size:
        return np.array([0.0, 1.0])
    core_low, core_high = np.quantile(known, _CORE)
    width = core_high - core_low
    if width > 0.0 and high - low > _FAR * width:
        low, high = max(low, core_low - width / 10.0), min(high, core_high + width / 10.0)
    for bound in (column.minimum, column.maximum):
        if bound is not None and low - (high - low) <= bound <= high + (high - low):
            # A little farther, so that the line is not the frame of the picture.
            low, high = min(low, bound), max(high, bound + 0.02 * (high - low))
    if low == high:
        low, high = low - 0.5, high + 0.5
    return np.linspace(low, high, HISTOGRAM_BINS + 1)


@dataclass(frozen=True)
class Histogram:
    """Distribution of a measure.

    Attributes
    ----------
    edges : ndarray, shape (n + 1,)
    counts : CellCounts
        Shape (n + 2,); the first and the last count what is beyond the edges.
    """

    summary: MeasureSummary
    edges: Floats
    counts: CellCounts

    def table(self) -> Table:
        """Return the bins; the first and the last are open."""
        return {
            'low': np.concatenate([[-np.inf], self.edges]),
            'high': np.concatenate([self.edges, [np.inf]]),
            'passed': self.counts.passed,
            'not_passed': self.counts.runs - self.counts.passed,
        }

    def caption(self) -> str:
        """Return what the chart shows, in sentences."""
        column, summary = self.summary.column, self.summary
        if not summary.count:
            return 'No run has a value.'
        sentences = [f'{summary.count:,} runs; blue: passed, orange: not.']
        if summary.missing:
            sentences.append(f'{summary.missing:,} runs have no value.')
        below, above = self.counts.runs[[0, -1]].tolist()
        if below or above:
            sentences.append(f'Arrows: {below + above:,} runs with values farther out.')
        sentences.append('Dotted: quantiles 5, 50 and 95 %.')
        bounds = [each for each in (column.minimum, column.maximum) if each is not None]
        if hidden := [each for each in bounds if not self.edges[0] <= each <= self.edges[-1]]:
            shown = ', '.join(f'{each:g}' for each in hidden)
            sentences.append(f'Expected bound outside of the picture: {shown}.')
        elif bounds:
            sentences.append('Solid: expected bounds.')
        return ' '.join(sentences)

    def figure(self) -> ChartFigure:
        """Return the histogram, with the expected bounds and the quantiles."""
        column, inside = self.summary.column, slice(1, -1)
        passed, runs = self.counts.passed[inside], self.counts.runs[inside]
        layers: list[Layer] = [
            Bars(self.edges, passed, BLUE, 'passed'),
            Bars(self.edges, runs - passed, ORANGE, 'not passed'),
        ]
        for share, value in zip(QUANTILES, self.summary.quantiles.tolist(), strict=True):
            if share in (0.05, 0.5, 0.95) and np.isfinite(value):
                layers.append(VerticalLine(value, Line(GRAY, 1.2, ':')))
        bounds = (each for each in (column.minimum, column.maximum) if each is not None)
        layers += [VerticalLine(each, Line(INK, 1.6)) for each in bounds]
        x = Scale(with_unit(column.name, column.unit), float(self.edges[0]), float(self.edges[-1]))
        y = Scale('runs', 0.0, 1.05 * max(1.0, float(runs.max())))
        below, above = self.counts.runs[[0, -1]].tolist()
        return ChartFigure([Chart(x, y, layers, beyond=(below, above))], PANEL_WIDTH, 2.9)


@dataclass(frozen=True)
class ShareChart:
    """The share that passed over a single variable."""

    axis: Axis
    counts: CellCounts

    def intervals(self) -> Floats:
        """Return Wilson's 95 % intervals, shape (n, 2); NaN without runs."""
        pairs = zip(self.counts.passed.tolist(), self.counts.runs.tolist(), strict=True)
        none = (np.nan, np.nan)
        return np.array([wilson_interval(*each) if each[1] else none for each in pairs])

    def table(self) -> Table:
        """Return the levels or bins."""
        low, high = self.intervals().T
        return {
            self.axis.label: self.axis.shown,
            'runs': self.counts.runs,
            'passed': self.counts.passed,
            'share_passed': self.counts.share,
            'low_95': low,
            'high_95': high,
        }

    def caption(self) -> str:
        """Return the meaning of the variable."""
        meaning = self.axis.column.meaning
        return f'{meaning[:1].upper()}{meaning[1:]}.' if meaning else ''

    def figure(self) -> ChartFigure:
        """Return the share with its intervals."""
        low, high = self.intervals().T * 100.0
        is_joined = not self.axis.is_words and self.axis.cells > MOST_BINS
        shares = ErrorBars(self.axis.middles, self.counts.share * 100.0, low, high, '%', is_joined)
        chart = Chart(scale_of(self.axis), Scale('passed [%]', -2.0, 102.0), [shares])
        return ChartFigure([chart], PANEL_WIDTH, 2.6)


def sensitivity_table(found: Sensitivity) -> Table:
    """Return the indices, a row for each variable and result."""
    rows, columns = len(found.variables), len(found.results)
    return {
        'variable': np.repeat(np.array(found.variables, str), columns),
        'result': np.tile(np.array(found.results, str), rows),
        'first_order': found.first_order.ravel(),
        'first_order_half_width_95': found.half_width.ravel(),
        'pawn': found.pawn.ravel(),
        'pawn_without_influence': np.tile(found.floor, rows),
        'runs': np.tile(found.counts, rows),
    }


def sensitivity_figure(found: Sensitivity) -> ChartFigure:
    """Return both indices, a row for each variable and a column for each result."""
    rows, columns = len(found.variables), len(found.results)
    x = Scale('', -0.5, columns - 0.5, words=tuple(found.results), is_upright=True)
    y = Scale('', rows - 0.5, -0.5, words=tuple(found.variables))
    charts = [
        # Small negative estimates mean no influence.
        Chart(x, y, [HeatMap(
            np.arange(-0.5, columns), np.arange(-0.5, rows), np.clip(values, 0.0, 1.0), 'index',
            '', 1.0, 'Blues', with_numbers=True,
        )], title)
        for values, title in (
            (found.first_order, 'first-order index (RBD-FAST)'), (found.pawn, 'PAWN index'),
        )
    ]  # fmt: skip
    height = 1.0 + 0.34 * rows + 0.075 * max(map(len, found.results))
    return ChartFigure(charts, WIDTH + 1.0, height)
