"""Charts over any quantity: declared once, drawn as a picture and described for the page."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from ballbot_ros.analysis.drawing import style_axes
from ballbot_ros.analysis.figure_parts import BLUE, INK, ORANGE, Line, new_figure
from ballbot_ros.analysis.interactive import DASHES, GRID, Json, chart_layout
from ballbot_ros.engine.rows import Column
from ballbot_ros.robot.arithmetic import Floats

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.patheffects import AbstractPathEffect


@dataclass(frozen=True)
class Scale:
    """An axis of a chart.

    Attributes
    ----------
    label : str
    low, high : float
        Its left and right end, or its lower and upper one.
    is_log : bool
        Whether it is logarithmic.
    words : tuple of str
        Names of the values 0, 1, …; none for numbers.
    """

    label: str
    low: float
    high: float
    is_log: bool = False
    words: tuple[str, ...] = ()


@dataclass(frozen=True)
class Cells:
    """Values in cells, as colours.

    Attributes
    ----------
    x, y : ndarray, shapes (n + 1,) and (m + 1,)
        Edges; those of words are -0.5, 0.5, ….
    values : ndarray, shape (m, n)
        NaN for nothing.
    label : str
        For the scale of the colours.
    top : float
        Where that scale ends; it begins at 0.
    colours : str
        One of :data:`COLOURS`.
    runs : ndarray of shape (m, n), or None
        Numbers of runs, which the page tells.
    with_numbers : bool
        Whether each cell has its value as a text.
    """

    x: Floats
    y: Floats
    values: Floats
    label: str
    top: float
    colours: str
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
class Points:
    """Points with intervals, each of shape (n,); if they are `joined`, a line in a band."""

    x: Floats
    y: Floats
    low: Floats
    high: Floats
    joined: bool


@dataclass(frozen=True)
class Path:
    """A line through points, shape (n, 2), with an edge in another colour."""

    points: Floats
    line: Line
    edge: str


@dataclass(frozen=True)
class Mark:
    """A vertical line."""

    x: float
    line: Line


Layer = Cells | Bars | Points | Path | Mark

COLOURS = {
    'cividis': 'Cividis',
    'Blues': [
        [0.0, '#F7FBFF'], [0.25, '#C6DBEF'], [0.5, '#6BAED6'], [0.75, '#2171B5'], [1.0, '#08306B'],
    ],
}  # fmt: skip
"""Scales of colours: what matplotlib calls them, and what Plotly calls or makes them of."""

_UNKNOWN = '#DDDDDD'
"""Behind cells with numbers, of which some have none."""

_INCH_PX = 96


@dataclass(frozen=True)
class Chart:
    """Layers on one pair of axes.

    Attributes
    ----------
    beyond : tuple of int
        Numbers of what is left and right of the axes, which an arrow tells.
    """

    x: Scale
    y: Scale
    layers: Sequence[Layer]
    title: str = ''
    beyond: tuple[int, int] = (0, 0)

    @property
    def cells(self) -> Cells | None:
        """Its layer of cells."""
        return next((each for each in self.layers if isinstance(each, Cells)), None)


@dataclass(frozen=True)
class ChartFigure:
    """Charts next to each other with one vertical axis; width and height are those of a picture.

    Attributes
    ----------
    charts : sequence of Chart
    width, height : float
        Of the picture [inch].
    """

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
        if cells := self.charts[0].cells:
            shades = some[0].collections[0]
            figure.colorbar(shades, ax=list(some), label=cells.label, shrink=0.9, pad=0.01)
        lines, names = some[0].get_legend_handles_labels()
        if once := dict(zip(names, lines, strict=True)):
            handles = list(once.values())
            figure.legend(handles=handles, loc='outside upper center', ncols=2, frameon=False)
        return figure

    def description(self) -> Json:
        """Return the figure of the page."""
        named = any(isinstance(each, Path) for chart in self.charts for each in chart.layers)
        has_head = named or any(chart.title for chart in self.charts)
        layout = {
            **chart_layout(), 'height': round(self.height * _INCH_PX), 'barmode': 'stack',
            'margin': {'l': 56, 'r': 12, 't': 64 if has_head else 34, 'b': 52},
        }  # fmt: skip
        traces: list[Json] = []
        count = len(self.charts)
        for place, chart in enumerate(self.charts):
            suffix = str(place + 1) if place else ''
            width = 1.0 / count
            domain = [place * width + (0.02 if place else 0.0), (place + 1) * width]
            layout[f'xaxis{suffix}'] = {**_axis(chart.x), 'domain': domain}
            layout['shapes'] += [_line(each) for each in chart.layers if isinstance(each, Mark)]
            layout['annotations'] += _notes(chart, domain)
            for layer in chart.layers:
                traces += [{**each, 'xaxis': f'x{suffix}'} for each in _traces(chart, layer)]
        layout['yaxis'] = _axis(self.charts[0].y)
        return {'data': traces, 'layout': layout}


def _draw_chart(axes: Axes, chart: Chart) -> None:
    bottom: Column | float = 0.0
    for layer in chart.layers:
        match layer:
            case Cells():
                _draw_cells(axes, layer)
            case Bars(edges, heights, color, _):
                axes.bar(edges[:-1], heights, np.diff(edges), bottom, align='edge', color=color)
                bottom = bottom + heights
            case Points():
                _draw_points(axes, layer)
            case Path(points, line, edge):
                axes.plot(
                    *points.T, color=line.color, linewidth=line.width, linestyle=line.dash,
                    label=line.label, path_effects=[_edge(line.width, edge)],
                )  # fmt: skip
            case Mark(x, line):
                axes.axvline(x, color=line.color, linewidth=line.width, linestyle=line.dash)
    if not chart.cells:
        style_axes(axes)
    axes.set_title(chart.title)
    _draw_scale(axes, 'x', chart.x)
    axes.set_xlim(chart.x.low, chart.x.high)
    axes.set_ylim(chart.y.low, chart.y.high)
    for place, align, text in _arrows(chart):
        axes.text(
            place, 1.02, text, color=ORANGE, ha=align, fontsize='small', transform=axes.transAxes
        )


def _draw_cells(axes: Axes, cells: Cells) -> None:
    axes.pcolormesh(
        cells.x, cells.y, np.ma.masked_invalid(cells.values), cmap=cells.colours,
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


def _draw_points(axes: Axes, points: Points) -> None:
    if points.joined:
        axes.fill_between(points.x, points.low, points.high, color=BLUE, alpha=0.25, linewidth=0.0)
        axes.plot(points.x, points.y, color=BLUE, linewidth=1.4)
        return
    axes.errorbar(
        points.x, points.y, _errors(points), fmt='o', markersize=4.0, color=BLUE, elinewidth=1.2,
        capsize=2.0,
    )  # fmt: skip


def _errors(points: Points) -> Floats:
    """Return the intervals as lengths, shape (2, n).

    A mean that is rounded may lie outside of its interval by the last digit.
    """
    return np.abs(np.stack([points.low, points.high]) - points.y)


def _edge(width: float, color: str) -> AbstractPathEffect:
    from matplotlib.patheffects import withStroke

    return withStroke(linewidth=width + 1.0, foreground=color)


_TURNS: Sequence[tuple[int, float, Literal['center', 'right']]] = (
    (150, 90.0, 'center'), (43, 30.0, 'right'), (0, 0.0, 'center'),
)  # fmt: skip
"""From how many letters on the words of an axis are turned, by how much, and their alignment."""


def _draw_scale(axes: Axes, which: str, scale: Scale) -> None:
    """Set up the horizontal (`which` is ``x``) or the vertical axis, but for its ends."""
    axis = axes.xaxis if which == 'x' else axes.yaxis
    axis.set_label_text(scale.label)
    if scale.words:
        axis.set_ticks(range(len(scale.words)), scale.words)
        if which == 'x':
            letters = sum(map(len, scale.words))
            _, turn, align = next(each for each in _TURNS if letters >= each[0])
            axis.set_tick_params(labelrotation=turn)
            for text in axis.get_ticklabels():
                text.set_horizontalalignment(align)
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
    axis: Json = {**GRID, 'title': {'text': scale.label}, 'automargin': True}
    ends = [scale.low, scale.high]
    if scale.words:
        return {**axis, 'type': 'category', 'categoryarray': list(scale.words), 'range': ends}
    if scale.is_log:
        return {**axis, 'type': 'log', 'range': np.log10(ends).tolist(), 'tickformat': '~g'}
    return {**axis, 'range': ends}


def _notes(chart: Chart, domain: Sequence[float]) -> list[Json]:
    """Return the title of a chart, and notes on what is beyond its axes."""
    middle = (domain[0] + domain[1]) / 2.0
    notes = [(middle, 'center', chart.title, INK)] if chart.title else []
    notes += [(place, align, text, ORANGE) for place, align, text in _arrows(chart)]
    return [
        {
            'text': text, 'x': x, 'xref': 'paper', 'xanchor': align, 'y': 1, 'yref': 'paper',
            'yanchor': 'bottom', 'showarrow': False, 'font': {'color': color, 'size': 12},
        }
        for x, align, text, color in notes
    ]  # fmt: skip


def _line(mark: Mark) -> Json:
    line = mark.line
    return {
        'type': 'line', 'x0': mark.x, 'x1': mark.x, 'yref': 'paper', 'y0': 0, 'y1': 1,
        'line': {'color': line.color, 'width': line.width, 'dash': DASHES[line.dash]},
    }  # fmt: skip


def _traces(chart: Chart, layer: Layer) -> list[Json]:
    match layer:
        case Cells():
            return [_cells_trace(chart, layer)]
        case Bars(edges, heights, color, name):
            ends = np.stack([edges[:-1], edges[1:]], axis=1)
            return [{
                'type': 'bar', 'x': _list(ends.mean(axis=1)), 'width': _list(np.diff(edges)),
                'y': _list(heights), 'marker': {'color': color, 'line': {'width': 0}}, 'name': name,
                'customdata': _list(ends), 'showlegend': False,
                'hovertemplate': '%{customdata[0]:.4~g} … %{customdata[1]:.4~g}: %{y:,} '
                f'{name}<extra></extra>',
            }]  # fmt: skip
        case Points():
            return _points_traces(chart, layer)
        case Path(points, line, edge):
            x, y = map(_list, points.T)
            curve = {'type': 'scatter', 'mode': 'lines', 'showlegend': False}
            around = {'color': edge, 'width': line.width + 1.5}
            look = {'color': line.color, 'width': line.width, 'dash': DASHES[line.dash]}
            words = f'{line.label}: %{{x:.4~g}}, %{{y:.4~g}}<extra></extra>'
            traces = [
                {**curve, 'x': x, 'y': y, 'line': around, 'hoverinfo': 'skip'},
                {**curve, 'x': x, 'y': y, 'line': look, 'hovertemplate': words},
            ]
            if _is_first(chart, layer):
                # White is not seen on the page.
                seen = {**look, 'color': INK if line.color == 'white' else line.color}
                named = {'name': line.label, 'showlegend': True, 'line': seen}
                traces.append({**curve, 'x': [None], 'y': [None], **named})
            return traces
        case Mark():
            return []


def _cells_trace(chart: Chart, cells: Cells) -> Json:
    x, y = chart.x.words, chart.y.words
    names = ['%{x}' if x else '%{x:.4~g}', '%{y}' if y else '%{y:.4~g}']
    value = '%{z:.3~f}' if cells.with_numbers else '%{z:.1f} % of %{customdata:,} runs'
    trace = {
        'type': 'heatmap', 'x': list(x) or _list(cells.x), 'y': list(y) or _list(cells.y),
        'z': _list(cells.values), 'zmin': 0, 'zmax': cells.top, 'hoverongaps': False,
        'colorscale': COLOURS[cells.colours],
        'hovertemplate': f'{", ".join(names)}: {value}<extra></extra>',
        'colorbar': {'title': {'text': cells.label, 'side': 'right'}, 'thickness': 14},
    }  # fmt: skip
    if cells.runs is not None:
        trace['customdata'] = _list(cells.runs)
    if cells.with_numbers:
        trace['text'] = [[_number(value) for value in row] for row in cells.values]
        trace['texttemplate'] = '%{text}'
    return trace


def _points_traces(chart: Chart, points: Points) -> list[Json]:
    words = chart.x.words
    x = [words[round(each)] for each in points.x] if words else _list(points.x)
    low, high = _list(points.low), _list(points.high)
    less, more = map(_list, _errors(points))
    trace = {
        'type': 'scatter', 'x': x, 'y': _list(points.y), 'showlegend': False,
        'customdata': [list(each) for each in zip(low, high, strict=True)],
        'hovertemplate': f'{"%{x}" if words else "%{x:.4~g}"}: %{{y:.1f}} % '
        '(%{customdata[0]:.1f} … %{customdata[1]:.1f} %)<extra></extra>',
    }  # fmt: skip
    if not points.joined:
        errors = {'type': 'data', 'symmetric': False, 'array': more, 'arrayminus': less}
        return [{
            **trace, 'mode': 'markers', 'marker': {'color': BLUE, 'size': 6},
            'error_y': {**errors, 'color': BLUE, 'thickness': 1.2, 'width': 2},
        }]  # fmt: skip
    end = {
        'type': 'scatter', 'mode': 'lines', 'x': x, 'line': {'width': 0}, 'hoverinfo': 'skip',
        'showlegend': False,
    }  # fmt: skip
    band = {'fill': 'tonexty', 'fillcolor': 'rgba(86, 180, 233, 0.3)'}
    return [
        {**end, 'y': low},
        {**end, **band, 'y': high},
        {**trace, 'mode': 'lines', 'line': {'color': BLUE, 'width': 1.4}},
    ]


def _is_first(chart: Chart, path: Path) -> bool:
    """Return whether a line is the first one of its name."""
    named = (each for each in chart.layers if isinstance(each, Path))
    return path is next(each for each in named if each.line.label == path.line.label)


def _list(values: Column) -> Any:
    """Return numbers with six digits as JSON has them; None for none."""
    if values.ndim > 1:
        return [_list(row) for row in values]
    return [float(f'{each:.6g}') if np.isfinite(each) else None for each in values.tolist()]
