"""Charts over any quantity: declared once, drawn as a picture and described for the page."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from typing import TYPE_CHECKING, Any

import numpy as np

from ballbot_ros.analysis.drawing import draw_line, style_axes
from ballbot_ros.analysis.figure_parts import BLUE, INK, ORANGE, Line, new_figure
from ballbot_ros.analysis.interactive import GRID, Json, chart_layout, note, stroke
from ballbot_ros.engine.rows import Column
from ballbot_ros.robot.arithmetic import Floats

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class Scale:
    """An axis of a chart.

    Attributes
    ----------
    low, high : float
        Its left and right end, or its lower and upper one.
    is_log : bool
        Whether it is logarithmic.
    words : tuple of str
        Names of the values 0, 1, …; none for numbers.
    is_upright : bool
        Whether the words of a horizontal axis are written upwards.
    """

    label: str
    low: float
    high: float
    is_log: bool = False
    words: tuple[str, ...] = ()
    is_upright: bool = False


@dataclass(frozen=True)
class HeatMap:
    """Values in cells, as colours.

    Attributes
    ----------
    x, y : ndarray, shapes (n + 1,) and (m + 1,)
        Edges; those of words are -0.5, 0.5, ….
    values : ndarray, shape (m, n)
        NaN for cells without a value.
    label, unit : str
        Label of the colour bar, and unit of the values or ''.
    top : float
        Upper end of the colour bar, which begins at 0.
    color_map : str
        One of :data:`COLOR_MAPS`.
    runs : ndarray of shape (m, n), or None
        Number of runs in each cell, shown on hover.
    with_numbers : bool
        Whether the value is written into each cell.
    """

    x: Floats
    y: Floats
    values: Floats
    label: str
    unit: str
    top: float
    color_map: str
    runs: Column | None = None
    with_numbers: bool = False


@dataclass(frozen=True)
class Bars:
    """Bars between edges, shape (n + 1,), on top of those before; heights have the shape (n,)."""

    edges: Floats
    heights: Column
    color: str
    name: str


@dataclass(frozen=True)
class ErrorBars:
    """Points with intervals, each of shape (n,); if `is_joined`, a line in a band."""

    x: Floats
    y: Floats
    low: Floats
    high: Floats
    unit: str
    is_joined: bool


@dataclass(frozen=True)
class Contour:
    """A line through points, shape (n, 2), with an edge in another colour."""

    points: Floats
    line: Line
    edge: str


@dataclass(frozen=True)
class VerticalLine:
    """A vertical line."""

    x: float
    line: Line


Layer = HeatMap | Bars | ErrorBars | Contour | VerticalLine

COLOR_MAPS = {
    'cividis': 'Cividis',
    'Blues': [
        [0.0, '#F7FBFF'], [0.25, '#C6DBEF'], [0.5, '#6BAED6'], [0.75, '#2171B5'], [1.0, '#08306B'],
    ],
}  # fmt: skip
"""Colour maps: matplotlib's name, and Plotly's name or stops."""

_UNKNOWN = '#DDDDDD'
"""Background of cells without a number."""

_INCH_PX = 96
_GAP = 0.02
"""Gap between charts, as a part of the width."""


@dataclass(frozen=True)
class Chart:
    """Layers on one pair of axes.

    `beyond` are the numbers of runs below and above the horizontal axis, shown next to arrows.
    """

    x: Scale
    y: Scale
    layers: Sequence[Layer]
    title: str = ''
    beyond: tuple[int, int] = (0, 0)

    @property
    def heat_map(self) -> HeatMap | None:
        """Its heat map, if it has one."""
        return next((each for each in self.layers if isinstance(each, HeatMap)), None)


@dataclass(frozen=True)
class ChartFigure:
    """Charts next to each other with one vertical axis; `width` and `height` are in inch."""

    charts: Sequence[Chart]
    width: float
    height: float

    def draw(self) -> Figure:
        """Draw the picture."""
        figure = new_figure(self.width, self.height)
        some = figure.subplots(1, len(self.charts), sharey=True, squeeze=False)[0]
        for chart, axes in zip(self.charts, some, strict=True):
            _draw_chart(axes, chart)
        _draw_scale(some[0], 'y', self.charts[0].y)
        if cells := self.charts[0].heat_map:
            shades = some[0].collections[0]
            figure.colorbar(shades, ax=list(some), label=cells.label, shrink=0.9, pad=0.01)
        lines, names = some[0].get_legend_handles_labels()
        if once := dict(zip(names, lines, strict=True)):
            handles = list(once.values())
            figure.legend(handles=handles, loc='outside upper center', ncols=2, frameon=False)
        return figure

    def description(self) -> Json:
        """Return the figure of the page."""
        layout = {
            **chart_layout(), 'height': round(self.height * _INCH_PX), 'barmode': 'stack',
            'margin': {'l': 56, 'r': 12, 't': max(map(_top_px, self.charts)), 'b': 52},
        }  # fmt: skip
        traces: list[Json] = []
        width = 1.0 / len(self.charts)
        for place, chart in enumerate(self.charts):
            axis = f'x{place + 1}' if place else 'x'
            domain = [place * width + (_GAP if place else 0.0), (place + 1) * width]
            layout[axis.replace('x', 'xaxis')] = {**_axis(chart.x), 'domain': domain}
            layout['annotations'] += _notes(chart, domain)
            for layer in chart.layers:
                if isinstance(layer, VerticalLine):
                    layout['shapes'].append(_line(layer, axis))
                else:
                    # One colour bar for all charts.
                    more = {'xaxis': axis, 'showscale': False} if place else {'xaxis': axis}
                    traces += [{**each, **more} for each in _traces(chart, layer)]
        layout['yaxis'] = _axis(self.charts[0].y)
        return {'data': traces, 'layout': layout}


def _draw_chart(axes: Axes, chart: Chart) -> None:
    from matplotlib.patheffects import withStroke

    bottom: Column | float = 0.0
    for layer in chart.layers:
        match layer:
            case HeatMap():
                _draw_cells(axes, layer)
            case Bars(edges, heights, color, _):
                axes.bar(edges[:-1], heights, np.diff(edges), bottom, align='edge', color=color)
                bottom = bottom + heights
            case ErrorBars():
                _draw_points(axes, layer)
            case Contour(points, line, edge):
                x, y = points.T
                draw_line(axes, x, y, line)
                around = withStroke(linewidth=line.width + 1.0, foreground=edge)
                axes.lines[-1].set_path_effects([around])
            case VerticalLine(x, line):
                axes.axvline(x, color=line.color, linewidth=line.width, linestyle=line.dash)
    if not chart.heat_map:
        style_axes(axes)
    axes.set_title(chart.title)
    _draw_scale(axes, 'x', chart.x)
    axes.set_xlim(chart.x.low, chart.x.high)
    axes.set_ylim(chart.y.low, chart.y.high)
    for place, align, text in _arrows(chart):
        axes.text(
            place, 1.02, text, color=ORANGE, ha=align, fontsize='small', transform=axes.transAxes
        )


def _draw_cells(axes: Axes, cells: HeatMap) -> None:
    axes.pcolormesh(
        cells.x, cells.y, np.ma.masked_invalid(cells.values), cmap=cells.color_map,
        vmin=0.0, vmax=cells.top,
    )  # fmt: skip
    if not cells.with_numbers:
        return
    axes.set_facecolor(_UNKNOWN)
    axes.tick_params(length=0)
    for (row, column), value in np.ndenumerate(cells.values):
        color = 'white' if value > 0.6 * cells.top else 'black'
        axes.text(
            column, row, _number(value), color=color, ha='center', va='center', fontsize='small'
        )


def _number(value: float) -> str:
    return '–' if np.isnan(value) else f'{value:.2f}'.removeprefix('0')


def _draw_points(axes: Axes, points: ErrorBars) -> None:
    if points.is_joined:
        axes.fill_between(points.x, points.low, points.high, color=BLUE, alpha=0.25, linewidth=0.0)
        draw_line(axes, points.x, points.y, Line(BLUE))
        return
    axes.errorbar(
        points.x, points.y, _errors(points), fmt='o', markersize=4.0, color=BLUE, elinewidth=1.2,
        capsize=2.0,
    )  # fmt: skip


def _errors(points: ErrorBars) -> Floats:
    """Return the intervals as lengths, shape (2, n).

    A mean that is rounded may lie outside of its interval by the last digit.
    """
    return np.abs(np.stack([points.low, points.high]) - points.y)


_BAND = 'rgba(0, 114, 178, 0.3)'
"""The colour of intervals on the page: blue, translucent."""

_MANY_LETTERS = 43
"""Number of letters from which the words of a horizontal axis are slanted."""


def _draw_scale(axes: Axes, which: str, scale: Scale) -> None:
    """Set up the horizontal (`which` is ``x``) or the vertical axis, but for its ends."""
    axis = axes.xaxis if which == 'x' else axes.yaxis
    axis.set_label_text(scale.label)
    if scale.words:
        axis.set_ticks(range(len(scale.words)), scale.words)
        if which == 'x':
            is_slanted = sum(map(len, scale.words)) >= _MANY_LETTERS and not scale.is_upright
            axis.set_tick_params(labelrotation=90 if scale.is_upright else 30 * is_slanted)
            for text in axis.get_ticklabels():
                text.set_horizontalalignment('right' if is_slanted else 'center')
                text.set_fontsize(min(text.get_fontsize(), 220.0 / len(scale.words)))
    if scale.is_log:
        from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

        axes.set(**{f'{which}scale': 'log'})
        # Plain numbers: figures have no formulas.
        axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axis.set_major_formatter(FuncFormatter(lambda value, _: f'{value:g}'))
        axis.set_minor_formatter(NullFormatter())


def _arrows(chart: Chart) -> list[tuple[float, str, str]]:
    """Return where a note on what is beyond the axes is, its alignment and its text."""
    left, right = chart.beyond
    notes = (0.0, 'left', left, f'← {left:,}'), (1.0, 'right', right, f'{right:,} →')
    return [(place, align, text) for place, align, count, text in notes if count]


def _axis(scale: Scale) -> Json:
    """Return an axis of the page; that of words has them as categories."""
    ends = [scale.low, scale.high]
    axis: Json = {**GRID, 'title': {'text': _plain(scale.label)}, 'automargin': True}
    if scale.words:
        turn = {'tickangle': -90} if scale.is_upright else {}
        words = _categories(scale)
        return {**axis, **turn, 'type': 'category', 'categoryarray': words, 'range': ends}
    if scale.is_log:
        ticks = '.3~e' if scale.low < 1e-3 else '~g'
        return {**axis, 'type': 'log', 'range': np.log10(ends).tolist(), 'tickformat': ticks}
    return {**axis, 'range': ends, 'exponentformat': 'e'}


def _categories(scale: Scale) -> list[str]:
    return [_plain(each) for each in scale.words]


def _plain(text: str) -> str:
    """Return a text such that Plotly, which knows some HTML, shows it as it is."""
    return escape(text, quote=False)


def _top_px(chart: Chart) -> int:
    """Return the height above a chart: of its title or legend, and of the buttons."""
    if chart.title or any(isinstance(each, Contour) for each in chart.layers):
        return 64
    return 54 if any(chart.beyond) else 34


def _notes(chart: Chart, domain: Sequence[float]) -> list[Json]:
    """Return the title of a chart, and notes on what is beyond its axes."""
    left, right = domain
    notes = [((left + right) / 2.0, 'center', chart.title, INK)] if chart.title else []
    notes += [
        (left + place * (right - left), align, text, ORANGE)
        for place, align, text in _arrows(chart)
    ]
    return [note(_plain(text), 1.0, x, align, color) for x, align, text, color in notes]


def _line(mark: VerticalLine, axis: str) -> Json:
    return {
        'type': 'line', 'xref': axis, 'x0': mark.x, 'x1': mark.x, 'yref': 'paper', 'y0': 0, 'y1': 1,
        'line': stroke(mark.line),
    }  # fmt: skip


def _traces(chart: Chart, layer: HeatMap | Bars | ErrorBars | Contour) -> list[Json]:
    x_place, y_place = _place('x', chart.x), _place('y', chart.y)
    match layer:
        case HeatMap():
            return [_cells_trace(chart, layer)]
        case Bars(edges, heights, color, name):
            ends = np.stack([edges[:-1], edges[1:]], axis=1)
            low, high = (_place(f'customdata[{each}]', chart.x) for each in range(2))
            return [{
                'type': 'bar', 'x': _list(ends.mean(axis=1)), 'width': _list(np.diff(edges)),
                'y': _list(heights), 'marker': {'color': color, 'line': {'width': 0}}, 'name': name,
                'customdata': _list(ends), 'showlegend': False,
                'hovertemplate': f'{low} … {high}: %{{y:,}} {name}<extra></extra>',
            }]  # fmt: skip
        case ErrorBars():
            return _points_traces(chart, layer)
        case Contour(points, line, edge):
            x, y = map(_list, points.T)
            curve = {'type': 'scatter', 'mode': 'lines', 'showlegend': False}
            around = {'color': edge, 'width': line.width + 1.5}
            look = stroke(line)
            words = f'{_plain(line.label)}: {x_place}, {y_place}<extra></extra>'
            traces = [
                {**curve, 'x': x, 'y': y, 'line': around, 'hoverinfo': 'skip'},
                {**curve, 'x': x, 'y': y, 'line': look, 'hovertemplate': words},
            ]
            if _is_first(chart, layer):
                # White is not seen on the page.
                seen = {**look, 'color': INK if line.color == 'white' else line.color}
                named = {'name': _plain(line.label), 'showlegend': True, 'line': seen}
                traces.append({**curve, 'x': [None], 'y': [None], **named})
            return traces


def _place(number: str, scale: Scale) -> str:
    """Return how a hover shows a place on an axis: to a thousandth of its length."""
    if scale.words:
        return f'%{{{number}}}'
    if scale.is_log:
        return f'%{{{number}:.4~g}}'
    decimals = max(0, 3 - math.floor(math.log10(abs(scale.high - scale.low))))
    return f'%{{{number}:.{decimals}~f}}'


def _cells_trace(chart: Chart, cells: HeatMap) -> Json:
    place = f'{_place("x", chart.x)}, {_place("y", chart.y)}'
    runs = '' if cells.runs is None else ' of %{customdata:,} runs'
    trace = {
        'type': 'heatmap', 'x': _categories(chart.x) or _list(cells.x),
        'y': _categories(chart.y) or _list(cells.y), 'z': _list(cells.values), 'zmin': 0,
        'zmax': cells.top, 'hoverongaps': False, 'colorscale': COLOR_MAPS[cells.color_map],
        'colorbar': {'title': {'text': cells.label, 'side': 'right'}, 'thickness': 14},
        'hovertemplate': f'{place}: %{{z:.3~g}} {cells.unit}{runs}<extra></extra>',
    }  # fmt: skip
    if cells.runs is not None:
        trace['customdata'] = _list(cells.runs)
    if cells.with_numbers:
        trace['text'] = [[_number(value) for value in row] for row in cells.values]
        trace['texttemplate'] = '%{text}'
    return trace


def _points_traces(chart: Chart, points: ErrorBars) -> list[Json]:
    words = _categories(chart.x)
    x = [words[round(each)] for each in points.x] if words else _list(points.x)
    low, high = _list(points.low), _list(points.high)
    less, more = map(_list, _errors(points))
    interval = '(%{customdata[0]:.3~g} … %{customdata[1]:.3~g})'
    trace = {
        'type': 'scatter', 'x': x, 'y': _list(points.y), 'showlegend': False,
        'customdata': [list(each) for each in zip(low, high, strict=True)],
        'hovertemplate': f'{_place("x", chart.x)}: %{{y:.3~g}} {interval} {points.unit}'
        '<extra></extra>',
    }  # fmt: skip
    if not points.is_joined:
        errors = {'type': 'data', 'symmetric': False, 'array': more, 'arrayminus': less}
        return [{
            **trace, 'mode': 'markers', 'marker': {'color': BLUE, 'size': 6},
            'error_y': {**errors, 'color': BLUE, 'thickness': 1.2, 'width': 2},
        }]  # fmt: skip
    end = {
        'type': 'scatter', 'mode': 'lines', 'x': x, 'line': {'width': 0}, 'hoverinfo': 'skip',
        'showlegend': False,
    }  # fmt: skip
    band = {'fill': 'tonexty', 'fillcolor': _BAND}
    return [
        {**end, 'y': low},
        {**end, **band, 'y': high},
        {**trace, 'mode': 'lines', 'line': {'color': BLUE, 'width': 1.4}},
    ]


def _is_first(chart: Chart, path: Contour) -> bool:
    """Return whether a line is the first one of its name."""
    named = (each for each in chart.layers if isinstance(each, Contour))
    return path is next(each for each in named if each.line.label == path.line.label)


def _list(values: Column) -> Any:
    """Return numbers as JSON has them; None for those that are not finite."""
    if values.ndim > 1:
        return [_list(row) for row in values]
    return [each if math.isfinite(each) else None for each in values.tolist()]
