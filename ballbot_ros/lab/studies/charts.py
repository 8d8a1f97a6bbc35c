"""Charts of a study: distributions, the share that passed over a variable, and sensitivities."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ballbot_ros.analysis.drawing import style_axes
from ballbot_ros.analysis.figure_parts import BLUE, GRAY, ORANGE, WIDTH, Table, new_figure
from ballbot_ros.lab.studies.columns import MeasureColumn
from ballbot_ros.lab.studies.maps import PANEL_WIDTH, set_scale
from ballbot_ros.lab.studies.sensitivity import Sensitivity
from ballbot_ros.lab.studies.study_data import QUANTILES, MeasureSummary, wilson_interval
from ballbot_ros.lab.studies.survey import Axis, CellCounts, Extent, with_unit
from ballbot_ros.robot.arithmetic import Floats

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


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

    Parameters
    ----------
    sample : ndarray, shape (r,)
        Values of some runs; those that are NaN or infinite do not count.
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
    summary : MeasureSummary
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
            sentences.append('Black: expected bounds.')
        return ' '.join(sentences)

    def draw(self) -> Figure:
        """Draw the histogram, the expected bounds and the quantiles."""
        figure = new_figure(PANEL_WIDTH, 2.9)
        axes = figure.subplots()
        passed = self.counts.passed[1:-1]
        others = self.counts.runs[1:-1] - passed
        widths = np.diff(self.edges)
        left = self.edges[:-1]
        axes.bar(left, passed, widths, align='edge', color=BLUE)
        axes.bar(left, others, widths, passed, align='edge', color=ORANGE)
        style_axes(axes)
        for share, value in zip(QUANTILES, self.summary.quantiles.tolist(), strict=True):
            if share in (0.05, 0.5, 0.95):
                axes.axvline(value, color=GRAY, linewidth=1.2, linestyle=':')
        for end, count in ((0.0, self.counts.runs[0]), (1.0, self.counts.runs[-1])):
            if count:
                arrow, place = (f'{count:,} →', 'right') if end else (f'← {count:,}', 'left')
                axes.text(
                    end, 1.02, arrow, color=ORANGE, ha=place, fontsize='small',
                    transform=axes.transAxes,
                )  # fmt: skip
        for bound in (self.summary.column.minimum, self.summary.column.maximum):
            if bound is not None:
                axes.axvline(bound, color='black', linewidth=1.6)
        axes.set_xlim(self.edges[0], self.edges[-1])
        axes.set_xlabel(with_unit(self.summary.column.name, self.summary.column.unit))
        axes.set_ylabel('runs')
        return figure


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

    def draw(self) -> Figure:
        """Draw the share with its intervals."""
        figure = new_figure(PANEL_WIDTH, 2.6)
        axes = figure.subplots()
        share, intervals = self.counts.share * 100.0, self.intervals() * 100.0
        x = self.axis.middles
        # A mean that is rounded may lie outside of its interval by the last digit.
        errors = np.abs(intervals.T - share)
        if self.axis.is_words or self.axis.cells <= MOST_BINS:
            axes.errorbar(
                x, share, errors, fmt='o', markersize=4.0, color=BLUE, elinewidth=1.2, capsize=2.0
            )
        else:
            axes.fill_between(x, *intervals.T, color=BLUE, alpha=0.25, linewidth=0.0)
            axes.plot(x, share, color=BLUE, linewidth=1.4)
        style_axes(axes)
        set_scale(axes, self.axis)
        axes.set_ylim(-2.0, 102.0)
        axes.set_ylabel('passed [%]')
        return figure


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


def draw_sensitivity(found: Sensitivity) -> Figure:
    """Draw both indices, a row for each variable and a column for each result."""
    rows = len(found.variables)
    longest = max(map(len, found.results))
    figure = new_figure(WIDTH + 1.0, 1.0 + 0.34 * rows + 0.075 * longest)
    both = np.asarray(figure.subplots(1, 2, sharey=True))
    titles = ('first-order index (RBD-FAST)', 'PAWN index')
    for axes, values, title in zip(both, (found.first_order, found.pawn), titles, strict=True):
        image = _draw_indices(axes, found, values)
        axes.set_title(title)
    both[0].set_yticks(np.arange(rows), found.variables)
    figure.colorbar(image, ax=both, label='index', shrink=0.9, pad=0.01)
    return figure


def _draw_indices(axes: Axes, found: Sensitivity, values: Floats) -> Any:
    # Small negative estimates mean no influence.
    shown = np.clip(values, 0.0, 1.0)
    image = axes.imshow(
        np.ma.masked_invalid(shown), cmap='Blues', vmin=0.0, vmax=1.0, aspect='auto'
    )
    axes.set_facecolor('#DDDDDD')
    axes.set_xticks(np.arange(len(found.results)), found.results, rotation=90)
    axes.tick_params(length=0)
    for (row, column), value in np.ndenumerate(shown):
        text = '–' if np.isnan(value) else f'{value:.2f}'.removeprefix('0')
        color = 'white' if value > 0.6 else 'black'
        axes.text(column, row, text, color=color, ha='center', va='center', fontsize='small')
    return image
