"""Maps of the share that passed over two variables, and their boundary."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from ballbot_ros.analysis.style import ORANGE, Line, new_figure
from ballbot_ros.analysis.table import Table
from ballbot_ros.studies.axes import Axis
from ballbot_ros.studies.contours import Lines, contour_lines
from ballbot_ros.studies.survey import CellCounts
from ballbot_ros.studies.theory import Prediction

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.axis import XAxis, YAxis
    from matplotlib.figure import Figure

Floats = NDArray[np.float64]

PANEL_WIDTH = 4.6
"""Width of a figure of which two are next to each other [inch]."""

RUNS_PER_CELL = 25
"""Mean number of runs in a cell of random samples."""

LEAST_BINS, MOST_BINS = 4, 50

_LEAST_WEIGHT = 0.5
"""Number of runs near a cell, weighted by distance, that make its smoothed share known."""

_MEASURED, _PREDICTED = Line('white', 1.4, label='50 % pass'), Line(ORANGE, 1.8, '--')
_TOO_LONG = 14


def map_bins(runs: int) -> int:
    """Return the number of bins of each axis of a map of so many runs."""
    return int(np.clip((runs / RUNS_PER_CELL) ** 0.5, LEAST_BINS, MOST_BINS))


@dataclass(frozen=True)
class PassMap:
    """A map of the share that passed.

    Attributes
    ----------
    x, y : Axis
    counts : CellCounts
        Each (cells of y, cells of x).
    prediction : Prediction or None
        What theory says.
    others : bool
        Whether more than the two variables vary; theory then has the medians of the others.
    """

    x: Axis
    y: Axis
    counts: CellCounts
    prediction: Prediction | None = None
    others: bool = False

    @property
    def smoothed(self) -> Floats:
        """The share whose contour at 50 % is the boundary, (cells of y, cells of x).

        Over levels it is the share itself. Over bins, where it scatters, it is smoothed with a
        Gaussian of one bin, weighted by the numbers of runs; NaN where there are none nearby.
        """
        widths = [0.0 if axis.levels is not None else 1.0 for axis in (self.y, self.x)]
        runs = gaussian_filter(self.counts.runs.astype(float), widths, mode='constant')
        passed = gaussian_filter(self.counts.passed.astype(float), widths, mode='constant')
        known = runs >= _LEAST_WEIGHT if any(widths) else runs > 0.0
        smoothed: Floats = np.divide(passed, runs, out=np.full(runs.shape, np.nan), where=known)
        return smoothed

    @property
    def boundary(self) -> Lines:
        """Lines on which half of the runs pass; none between words."""
        if self.x.is_words or self.y.is_words:
            return []
        stepped = self.x.is_stepped, self.y.is_stepped
        return contour_lines(self.x.middles, self.y.middles, self.smoothed, 0.5, stepped)

    def table(self) -> Table:
        """Return the cells, row by row."""
        columns, rows = np.meshgrid(np.arange(self.x.cells), np.arange(self.y.cells))
        return {
            self.x.label: self.x.shown[columns.ravel()],
            self.y.label: self.y.shown[rows.ravel()],
            'runs': self.counts.runs.ravel(),
            'passed': self.counts.passed.ravel(),
            'share_passed': self.counts.share.ravel(),
            'smoothed_share': self.smoothed.ravel(),
        }

    def line_table(self) -> Table:
        """Return the points of the boundary and of the prediction; each line has a number."""
        kinds: list[str] = []
        numbers: list[int] = []
        points = [np.empty((0, 2))]
        predicted = self.prediction.lines if self.prediction else []
        for kind, lines in (('measured', self.boundary), ('predicted', predicted)):
            for line in lines:
                numbers += [max(numbers, default=-1) + 1] * len(line)
                kinds += [kind] * len(line)
                points.append(line)
        joined = np.concatenate(points)
        return {
            'line': np.array(numbers, int),
            'kind': np.array(kinds, str),
            self.x.label: joined[:, 0],
            self.y.label: joined[:, 1],
        }

    def caption(self) -> str:
        """Return what the map shows, in sentences."""
        kinds = {axis.levels is None for axis in (self.x, self.y)}
        cells = {False: 'levels', True: 'bins'}[True in kinds]
        runs = self.counts.runs
        filled = runs[runs > 0]
        sentences = [f'Share that passed, by {cells}; {_runs_text(filled)}.']
        if filled.size < runs.size:
            sentences.append(f'{runs.size - filled.size:,} of {runs.size:,} cells are blank: no '
                             'runs.')  # fmt: skip
        if self.x.is_words or self.y.is_words:
            pass
        elif self.boundary:
            smooth = 'the share, smoothed over a bin,' if True in kinds else 'the share'
            sentences.append(f'On the white line {smooth} is 50 %.')
        else:
            sentences.append('There is no boundary: the share does not cross 50 %.')
        if self.prediction:
            sentences.append(self.prediction.sentence)
            if self.others:
                sentences.append('All else that varies has its median in this prediction.')
        return ' '.join(sentences)

    def draw(self) -> Figure:
        """Draw the map."""
        figure = new_figure(PANEL_WIDTH, 4.0)
        axes = figure.subplots()
        image = axes.pcolormesh(
            self.x.edges,
            self.y.edges,
            np.ma.masked_invalid(self.counts.share * 100.0),
            cmap='cividis',
            vmin=0.0,
            vmax=100.0,
        )
        figure.colorbar(image, ax=axes, label='passed [%]', shrink=0.9)
        _draw_lines(axes, self.boundary, _MEASURED, 'black')
        if self.prediction:
            _draw_lines(axes, self.prediction.lines, _PREDICTED, 'white')
        set_scale(axes, self.x, self.y)
        self._legend(figure)
        return figure

    def _legend(self, figure: Figure) -> None:
        from matplotlib.lines import Line2D
        from matplotlib.patheffects import withStroke

        handles = []
        if self.boundary:
            line = Line2D([], [], color=_MEASURED.color, linewidth=1.6, label=_MEASURED.label)
            line.set_path_effects([withStroke(linewidth=3.0, foreground='black')])
            handles.append(line)
        if self.prediction and self.prediction.lines:
            line = Line2D([], [], color=_PREDICTED.color, linewidth=1.8, linestyle='--')
            line.set_label(self.prediction.label)
            handles.append(line)
        if handles:
            figure.legend(handles=handles, loc='outside upper center', ncols=2, frameon=False)


def set_scale(axes: Axes, x: Axis, y: Axis | None = None) -> None:
    """Set scale, limits, ticks and labels of the axes of a map or, without `y`, of a chart."""
    axes.set_xlim(x.edges[0], x.edges[-1])
    axes.set_xlabel(x.label)
    if x.is_log:
        axes.set_xscale('log')
        _plain_ticks(axes.xaxis)
    if x.is_words:
        names = [str(each) for each in x.shown]
        slanted = sum(map(len, names)) > 3 * _TOO_LONG
        axes.set_xticks(
            x.middles, names, rotation=30 if slanted else 0, ha='right' if slanted else 'center'
        )
    if y is None:
        return
    axes.set_ylim(y.edges[0], y.edges[-1])
    axes.set_ylabel(y.label)
    if y.is_log:
        axes.set_yscale('log')
        _plain_ticks(axes.yaxis)
    if y.is_words:
        axes.set_yticks(y.middles, [str(each) for each in y.shown])


def _plain_ticks(axis: XAxis | YAxis) -> None:
    """Label a logarithmic axis with plain numbers: figures have no formulas."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f'{value:g}'))
    axis.set_minor_formatter(NullFormatter())


def _draw_lines(axes: Axes, lines: Lines, style: Line, halo: str) -> None:
    from matplotlib.patheffects import withStroke

    for line in lines:
        axes.plot(
            *line.T, color=style.color, linewidth=style.width, linestyle=style.dash,
            path_effects=[withStroke(linewidth=style.width + 1.0, foreground=halo)],
        )  # fmt: skip


def _runs_text(runs: NDArray[np.int64]) -> str:
    if not runs.size:
        return 'no runs'
    low, high = int(runs.min()), int(runs.max())
    if low == high:
        return f'{low:,} run in each cell' if low == 1 else f'{low:,} runs in each cell'
    return f'{low:,} to {high:,} runs in a cell, {int(np.median(runs)):,} in the median'
