"""Maps of the share that passed over two variables, and their boundary."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter, maximum_filter, minimum_filter

from ballbot_ros.analysis.chart import Chart, ChartFigure, Contour, HeatMap, Scale
from ballbot_ros.analysis.figure_parts import ORANGE, Line, Table
from ballbot_ros.controllers.design.linear_model import DesignError
from ballbot_ros.controllers.design.loop_analysis import recoverable_states
from ballbot_ros.controllers.design.sampled_loop import PARAMETERS, SampledLoop
from ballbot_ros.engine.rows import Column
from ballbot_ros.lab.studies.columns import ColumnKind
from ballbot_ros.lab.studies.programs import with_values
from ballbot_ros.lab.studies.survey import Axis, CellCounts, edges_between
from ballbot_ros.parameters import PLANT, ParameterSet
from ballbot_ros.robot.arithmetic import Floats

Lines = list[Floats]
"""Each (n, 2): x and y of its points."""


_STEP = 1e-6
"""Width of a step, as a part of the distance between its values."""


def contour_lines(
    x: Floats, y: Floats, values: Floats, level: float, stepped: tuple[bool, bool] = (False, False)
) -> Lines:
    """Return the lines of a level; they end where the field is NaN.

    Parameters
    ----------
    x, y : ndarray, shapes (n,) and (m,)
        Ascending coordinates of the grid.
    values : ndarray, shape (m, n)
        The field.
    stepped : tuple of bool
        Whether nothing lies between the coordinates x, and y, such as between whole numbers. There
        the lines run in the middle.
    """
    from matplotlib.figure import Figure

    known = values[~np.isnan(values)]
    if min(values.shape) < 2 or not known.size or not known.min() < level < known.max():
        return []
    if stepped[0]:
        x, values = _steps(x), np.repeat(values, 2, axis=1)
    if stepped[1]:
        y, values = _steps(y), np.repeat(values, 2, axis=0)
    found = Figure().subplots().contour(x, y, np.ma.masked_invalid(values), levels=[level])
    return [np.asarray(line, float) for line in found.allsegs[0] if len(line) > 1]


def _steps(axis: Floats) -> Floats:
    """Return both ends of the interval around each coordinate, shape (2n,)."""
    edges = edges_between(axis)
    lows, highs = edges[:-1], edges[1:]
    gap = _STEP * (highs - lows)
    return np.column_stack([lows + gap, highs - gap]).ravel()


Field = Callable[[float, float], float]
"""Of the values of both variables; positive beyond the limit."""

COARSE, DOUBLINGS = 17, 3
"""Points of an axis at which a limit is sought, and how often the grid is refined near it."""

_PITCHES = {(f'{PLANT}.start_pitch_{plane}', f'{PLANT}.start_pitch_rate_{plane}') for plane in 'xy'}


@dataclass(frozen=True)
class PredictedLimit:
    """A predicted limit on a map.

    Attributes
    ----------
    label : str
        For the legend.
    sentence : str
        What it is, and what it assumes.
    lines : list of ndarray, shape (n, 2) each
        The limit, as values of both variables; empty if it is nowhere on the map.
    """

    label: str
    sentence: str
    lines: Lines


def predict(parameters: ParameterSet, x: Axis, y: Axis) -> PredictedLimit | None:
    """Return the limit over two varied parameters, or None if theory knows none.

    Parameters
    ----------
    parameters : ParameterSet
        Those of the study, with a value for all that varies.
    x, y : Axis
        The axes of the map.
    """
    names = x.column.name, y.column.name
    if x.is_words or y.is_words:
        return None
    try:
        if names in _PITCHES or names[::-1] in _PITCHES:
            return _recoverable(parameters, x, y)
        if PARAMETERS.issuperset('.'.join(name.split('.')[:2]) for name in names):
            return _stable(parameters, x, y)
    except DesignError:
        pass
    return None


def _recoverable(parameters: ParameterSet, x_axis: Axis, y_axis: Axis) -> PredictedLimit:
    limit = recoverable_states(parameters)
    turned = (x_axis.column.name, y_axis.column.name) not in _PITCHES
    x, y = (np.linspace(each.edges[0], each.edges[-1], COARSE) for each in (x_axis, y_axis))
    columns, rows = np.meshgrid(x, y)
    pitch, rate = (rows, columns) if turned else (columns, rows)
    zero = np.zeros_like(pitch)
    # The share has a kink at 0; its two sides are planes, of which a coarse grid is exact.
    signed = np.stack([zero, pitch, zero, rate], axis=-1) @ limit.direction
    lines = [*contour_lines(x, y, signed, 1.0), *contour_lines(x, y, signed, -1.0)]
    return PredictedLimit(
        'limit of the motors',
        'The dashed line is the limit beyond which no controller can recover, since the motors at '
        'full voltage are too weak: by the linear model, with the ball at rest and the battery '
        "at its voltage at the start; it ignores the controller's own limits.",
        lines,
    )


def _stable(parameters: ParameterSet, x_axis: Axis, y_axis: Axis) -> PredictedLimit:
    axes = x_axis, y_axis
    names = [each.column.name for each in axes]
    kinds = [each.column.kind is ColumnKind.INTEGER for each in axes]

    def growth(x: float, y: float) -> float:
        pair = zip(names, (x, y), kinds, strict=True)
        changed = {name: round(value) if whole else value for name, value, whole in pair}
        loop = SampledLoop(with_values(parameters, changed))
        return float(np.abs(loop.poles()).max()) - 1.0

    x, y, excess = refined(growth, [_start(each) for each in axes], kinds)
    lines = contour_lines(x, y, excess, 0.0, (x_axis.is_stepped, y_axis.is_stepped))
    sentence = (
        'The dashed line is where the sampled loop becomes unstable (largest pole of magnitude 1): '
        'by the linear model, without quantisation, saturation, dead zone and gear play.'
    )
    if not lines:
        verdict = 'stable' if (excess < 0.0).all() else 'unstable'
        sentence = (
            f'By the linear model of the sampled loop, without quantisation, saturation, dead zone '
            f'and gear play, the loop is {verdict} all over this map.'
        )
    return PredictedLimit('predicted stability limit', sentence, lines)


def _start(axis: Axis) -> Floats:
    """Return the values of an axis from which a limit is sought; a constant has only one."""
    if axis.column.kind is ColumnKind.INTEGER:
        return axis.span.astype(float)
    return np.unique(np.linspace(axis.span[0], axis.span[-1], COARSE))


def refined(
    field: Field, axes: Sequence[Floats], fixed: Sequence[bool], doublings: int = DOUBLINGS
) -> tuple[Floats, Floats, Floats]:
    """Return values of a field on a grid that is fine enough for its zeros.

    The field is evaluated on a coarse grid, then at points between only where it changes its sign.
    The growth of a loop is that of its fastest pole, which changes abruptly from one to another: a
    coarse grid would have the limits in the wrong place.

    Parameters
    ----------
    field : callable
        Of both coordinates.
    axes : sequence of ndarray
        Ascending coordinates of the coarse grid, x and y.
    fixed : sequence of bool
        Whether no coordinates are added to an axis.

    Returns
    -------
    tuple of ndarray, shapes (n,), (m,) and (m, n)
        Coordinates x and y, and the values; far from zeros they are interpolated.
    """
    x, y = axes
    values = np.array([[field(a, b) for a in x.tolist()] for b in y.tolist()])
    exact = np.ones(values.shape, bool)
    for _ in range(doublings):
        finer_x, finer_y = (
            axis if is_fixed or len(axis) < 2 else _with_middles(axis)
            for axis, is_fixed in zip((x, y), fixed, strict=True)
        )
        wide = np.array([np.interp(finer_x, x, row) for row in values])
        finer = np.array([np.interp(finer_y, y, column) for column in wide.T]).T
        beyond = (finer > 0.0).astype(np.int8)
        near = maximum_filter(beyond, 3) != minimum_filter(beyond, 3)
        known = np.zeros(finer.shape, bool)
        known[np.ix_(np.isin(finer_y, y), np.isin(finer_x, x))] = exact
        for row, column in np.argwhere(near & ~known).tolist():
            finer[row, column] = field(float(finer_x[column]), float(finer_y[row]))
        x, y, values, exact = finer_x, finer_y, finer, known | near
    return x, y, values


def _with_middles(axis: Floats) -> Floats:
    result = np.empty(2 * len(axis) - 1)
    result[::2], result[1::2] = axis, (axis[1:] + axis[:-1]) / 2.0
    return result


def usual_values(columns: Mapping[str, Column]) -> dict[str, object]:
    """Return a value for each variable: the median of numbers, else the most frequent one."""
    values: dict[str, object] = {}
    for name, column in columns.items():
        if column.dtype.kind == 'f':
            values[name] = float(np.median(column))
        elif column.dtype.kind in 'iu':
            values[name] = int(np.quantile(column, 0.5, method='lower'))
        else:
            found, counts = np.unique(column, return_counts=True)
            values[name] = found[np.argmax(counts)].item()
    return values


PANEL_WIDTH = 4.6
"""Width of a figure of which two are next to each other [inch]."""

RUNS_PER_CELL = 25
"""Mean number of runs in a cell of random samples."""

LEAST_BINS, MOST_BINS = 4, 50

_LEAST_WEIGHT = 0.5
"""Number of runs near a cell, weighted by distance, that make its smoothed share known."""

_MEASURED, _PREDICTED = Line('white', 1.4, label='50 % pass'), Line(ORANGE, 1.8, '--')


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
    prediction: PredictedLimit | None = None
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

    def figure(self) -> ChartFigure:
        """Return the map."""
        shares = HeatMap(
            self.x.edges, self.y.edges, self.counts.share * 100.0, 'passed [%]', '%', 100.0,
            'cividis', self.counts.runs,
        )  # fmt: skip
        measured = [Contour(each, _MEASURED, 'black') for each in self.boundary]
        predicted = []
        if self.prediction:
            line = replace(_PREDICTED, label=self.prediction.label)
            predicted = [Contour(each, line, 'white') for each in self.prediction.lines]
        chart = Chart(scale_of(self.x), scale_of(self.y), [shares, *measured, *predicted])
        return ChartFigure([chart], PANEL_WIDTH, 4.0)


def scale_of(axis: Axis) -> Scale:
    """Return the axis of a map or a chart."""
    words = tuple(map(str, axis.shown)) if axis.is_words else ()
    low, high = float(axis.edges[0]), float(axis.edges[-1])
    return Scale(axis.label, low, high, axis.is_log, words, is_upright=len(words) > 12)


def _runs_text(runs: NDArray[np.int64]) -> str:
    if not runs.size:
        return 'no runs'
    low, high = int(runs.min()), int(runs.max())
    if low == high:
        return f'{low:,} run in each cell' if low == 1 else f'{low:,} runs in each cell'
    return f'{low:,} to {high:,} runs in a cell, {int(np.median(runs)):,} in the median'
