"""The interactive figures of a page: panels with one time axis, and the track.

They are figures of Plotly, described as its JSON. The page holds the description, the numbers and
Plotly's script, all compressed, so that a single file works without a network.
"""

from __future__ import annotations

import gzip
import json
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from importlib.resources import files
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ballbot_ros.analysis import drawing
from ballbot_ros.analysis.figure_parts import (
    BLUE,
    GRAY,
    INK,
    ON_DARK,
    ORANGE,
    PAPER,
    POINTS,
    DrawnCurve,
    Interval,
    IntervalKind,
    Line,
    Panel,
    Role,
    Row,
    Table,
    envelope,
    every_nth,
)
from ballbot_ros.analysis.run_data import RunData
from ballbot_ros.analysis.run_figures import FigureContent, track_marks
from ballbot_ros.engine.rows import Column
from ballbot_ros.robot.arithmetic import Floats
from ballbot_ros.robot.world.floor_map import FloorMap, OccupancyGrid

STEPS = 65_534
"""Steps into which the range of a column is divided; the next number stands for no number."""


class PackedColumn(NamedTuple):
    """Where a column is among the packed numbers: its first byte, and its number of values.

    Step 0 is `low`, and the last one `high`.
    """

    offset: int
    length: int
    low: float
    high: float


class PackedNumbers:
    """Columns of 16 bits a value, as differences; equal columns are kept once.

    The low bytes of a column come first, then the high ones: those of a smooth curve hardly differ,
    so that gzip makes them small.
    """

    def __init__(self) -> None:
        self._bytes = bytearray()
        self._known: dict[bytes, PackedColumn] = {}

    def add(self, values: Floats) -> PackedColumn:
        """Add a column, shape (n,), and return where it is; NaN and infinity are no numbers."""
        column = np.asarray(values, float)
        key = column.tobytes()
        if key not in self._known:
            self._known[key] = self._append(column)
        return self._known[key]

    def add_whole(self, values: NDArray[np.int64]) -> tuple[PackedColumn, PackedColumn]:
        """Add whole numbers below 2**30 such that the page has them exactly, as two columns."""
        high, low = np.divmod(values.astype(float), 2.0**15)
        return self.add(high), self.add(low)

    def _append(self, column: NDArray[np.float64]) -> PackedColumn:
        known = np.isfinite(column)
        low, high = _range(column)
        steps = np.full(len(column), STEPS + 1, np.uint16)
        steps[known] = np.rint((column[known] - low) / ((high - low) or 1.0) * STEPS)
        differences = np.diff(steps, prepend=np.uint16(0)).astype('<u2')
        packed = PackedColumn(len(self._bytes), len(column), low, high)
        self._bytes += (differences & 0xFF).astype(np.uint8).tobytes()
        self._bytes += (differences >> 8).astype(np.uint8).tobytes()
        return packed

    def compressed(self) -> bytes:
        """Return all columns, compressed with gzip; equal columns give equal bytes."""
        return gzip.compress(bytes(self._bytes), mtime=0)


def _range(values: Column) -> tuple[float, float]:
    """Return the smallest and the largest of the finite values."""
    known = values[np.isfinite(values)]
    return (float(known.min()), float(known.max())) if known.size else (0.0, 0.0)


MAX_ROWS = 6_000
"""Maximum number of rows of a table that the page holds: 24 s of ticks, or their extremes."""

MISSING = (
    'These are pictures. For figures to zoom into, install Plotly: '
    '`pip install "ballbot_ros[report]"`.'
)
"""What a report without Plotly says."""

_ROW_PX, _LANE_PX, _TOP_PX, _GAP_PX = 128, 26, 64, 30
_HIDDEN_AT_FIRST = (Role.ESTIMATED, Role.READING)
_DASHES = {'-': 'solid', '--': 'dash', '-.': 'dashdot', ':': 'dot'}
_SYMBOLS = {'.': 'circle', '|': 'line-ns-open', 'x': 'x-thin-open', '^': 'triangle-up'}
GRID = {'showgrid': True, 'zeroline': False, 'gridcolor': '#E3E5E7', 'linecolor': '#B0B4B8'}
_PAGE_ON_DARK = {
    '#E3E5E7': '#2C3136',
    '#B0B4B8': '#565C62',
    '#999999': '#747A80',
    '#CCCCCC': '#42484E',
}
Json = dict[str, Any]


@cache
def plotly_script() -> bytes | None:
    """Return Plotly's script, compressed with gzip; None if Plotly is not installed."""
    try:
        script = files('plotly').joinpath('package_data', 'plotly.min.js').read_bytes()
    except (ImportError, OSError):
        return None
    return gzip.compress(script, mtime=0)


@dataclass(frozen=True)
class InteractiveFigures:
    """What a page with interactive figures holds, all compressed with gzip.

    Attributes
    ----------
    description : bytes
        JSON: the figures by the id of their element, and the colours on a dark page.
    numbers : bytes
        The columns to which the description refers.
    names : tuple of str
        The ids of the figures' elements.
    covered : frozenset of str
        The names of the pictures that show the same.
    """

    plotly: bytes
    description: bytes
    numbers: bytes
    script: str
    names: tuple[str, ...]
    covered: frozenset[str]


class Events(NamedTuple):
    """When a time axis ends [s], intervals by kind, and the intervals that are shaded."""

    end: float
    lanes: Mapping[str, Sequence[Interval]] = {}
    marked: Sequence[Interval] = ()


def interactive_figures(
    run: RunData,
    contents: Sequence[FigureContent],
    others: Mapping[str, Callable[[PackedNumbers], Json]],
) -> InteractiveFigures | None:
    """Return the interactive figures of a run; None without Plotly or anything to show.

    `others` make further figures by name.
    """
    if not contents:
        return None

    def make(numbers: PackedNumbers) -> dict[str, Json]:
        events = Events(run.end, lanes_of(run), run.marked)
        figures = {'history': history_figure(merged_rows(contents), events, numbers)}
        track = next((each.table for each in contents if each.figure.name == 'track'), None)
        if track is not None:
            tracks = [(track, Line(BLUE))]
            figures['path'] = track_figure(tracks, run.floor, track_marks(run), numbers)
        return figures | {name: make_other(numbers) for name, make_other in others.items()}

    return packed_figures(make, (*(each.figure.name for each in contents), *others))


def packed_figures(
    make: Callable[[PackedNumbers], Mapping[str, Json]], covered: Iterable[str]
) -> InteractiveFigures | None:
    """Return figures as a page holds them; None without Plotly.

    `make` returns the figures by the ids of their elements, and packs their numbers. `covered` are
    the names of the pictures that show the same.
    """
    plotly = plotly_script()
    if plotly is None:
        return None
    numbers = PackedNumbers()
    figures = make(numbers)
    description = {'figures': figures, 'dark': {**ON_DARK, **_PAGE_ON_DARK}}
    return InteractiveFigures(
        plotly,
        gzip.compress(json.dumps(description, allow_nan=False).encode(), mtime=0),
        numbers.compressed(),
        files(__package__).joinpath('assets', 'interactive.js').read_text(encoding='utf-8'),
        tuple(figures),
        frozenset(covered),
    )


def history_figure(rows: Sequence[Row], events: Events, numbers: PackedNumbers) -> Json:
    """Return all rows against one time axis, one above the other, below the events."""
    lanes = events.lanes
    bottoms, tops = _domains(len(lanes), len(rows))
    traces = [_lane_trace(lanes)] if lanes else []
    height = _TOP_PX + len(lanes) * _LANE_PX + len(rows) * (_ROW_PX + _GAP_PX) + 40
    layout = {**_layout(), 'height': height}
    layout['yaxis'] = {
        'domain': [bottoms[0], tops[0]], 'range': [len(lanes) - 0.5, -0.5], 'fixedrange': True,
        'tickvals': list(range(len(lanes))), 'ticktext': list(lanes), 'showgrid': False,
        'zeroline': False,
    }  # fmt: skip
    shown: set[str] = set()
    for number, row in enumerate(rows, 2):
        layout[f'yaxis{number}'] = _value_axis(row, bottoms[number - 1], tops[number - 1])
        layout['annotations'].append(note(row.panel.label, tops[number - 1]))
        layout['shapes'] += [_limit(limit, number) for limit in row.panel.limits]
        traces += [_curve_trace(row.panel, each, number, shown, numbers) for each in row.curves]
    layout['xaxis'] = {
        **GRID, 'anchor': f'y{len(rows) + 1}', 'title': {'text': 'time [s]'},
        'range': [0.0, max(events.end, 1e-3)], 'hoverformat': '.3f', 'showspikes': True,
        'spikemode': 'across', 'spikesnap': 'cursor', 'spikethickness': 1, 'spikedash': 'solid',
        'spikecolor': GRAY, 'unifiedhovertitle': {'text': '%{x:.3f} s'},
    }  # fmt: skip
    layout['shapes'] += [_shade(each) for each in events.marked]
    return {'data': traces, 'layout': layout}


def merged_rows(contents: Iterable[FigureContent]) -> list[Row]:
    """Return one row for each quantity; a curve that several figures show appears once."""
    rows: dict[str, Row] = {}
    for content in contents:
        for panel in content.figure.panels:
            row = rows.setdefault(panel.label, Row(panel, ()))
            known = {(each.role, each.plane) for each in row.curves}
            new = panel.row(content.table).curves
            curves = tuple(each for each in new if (each.role, each.plane) not in known)
            rows[panel.label] = replace(row, curves=row.curves + curves)
    return [row for row in rows.values() if row.curves]


def lanes_of(run: RunData) -> dict[str, list[Interval]]:
    """Return the intervals of the run by kind: states, pushes and wall hits."""
    lanes: dict[str, list[Interval]] = {}
    for kind in IntervalKind:
        intervals = run.states if kind is IntervalKind.STATE else run.marked
        if some := [each for each in intervals if each.kind is kind]:
            lanes[kind.value] = some
    return lanes


def _domains(lanes: int, rows: int) -> tuple[list[float], list[float]]:
    """Return the bottoms and tops of the lanes and of each row, as shares of the height."""
    whole = max(1, lanes * _LANE_PX + rows * (_ROW_PX + _GAP_PX))  # there may be only a track
    tops = [1.0] + [
        1.0 - (lanes * _LANE_PX + row * (_ROW_PX + _GAP_PX) + _GAP_PX) / whole
        for row in range(rows)
    ]
    heights = [lanes * _LANE_PX, *[_ROW_PX] * rows]
    bottoms = [max(0.0, top - height / whole) for top, height in zip(tops, heights, strict=True)]
    return bottoms, tops


def _layout() -> Json:
    return {
        'margin': {'l': 56, 'r': 12, 't': _TOP_PX, 'b': 40}, 'autosize': True,
        'paper_bgcolor': 'rgba(0,0,0,0)', 'plot_bgcolor': 'rgba(0,0,0,0)',
        'font': {'color': INK, 'size': 12}, 'hovermode': 'x unified', 'hoversubplots': 'axis',
        'hoverdistance': 20, 'hoverlabel': {'bgcolor': PAPER, 'font': {'size': 10}},
        'legend': {
            'orientation': 'h', 'x': 0, 'yref': 'container', 'yanchor': 'top', 'tracegroupgap': 0,
        },
        'annotations': [], 'shapes': [], 'uirevision': 'zoom', 'dragmode': 'zoom',
    }  # fmt: skip


def chart_layout() -> Json:
    """Return the layout of a figure whose hover shows a single point."""
    return {**_layout(), 'hovermode': 'closest', 'hoversubplots': 'single'}


def _value_axis(row: Row, bottom: float, top: float) -> Json:
    axis = {**GRID, 'domain': [bottom, top], 'nticks': 5}
    if row.panel.bounds:
        return {**axis, 'range': list(row.panel.bounds)}
    low, high = _range(np.concatenate([each.values for each in row.curves]))
    if high - low < row.panel.min_span:
        middle, half = (low + high) / 2.0, row.panel.min_span / 2.0
        axis['range'] = [middle - half, middle + half]
    return axis


def note(text: str, y: float, x: float = 0.0, align: str = 'left', color: str = INK) -> Json:
    """Return a text above a place of the plot, which is given as shares of width and height."""
    return {
        'text': text, 'x': x, 'xref': 'paper', 'xanchor': align, 'y': y, 'yref': 'paper',
        'yanchor': 'bottom', 'showarrow': False, 'font': {'size': 12, 'color': color},
    }  # fmt: skip


def _limit(value: float, number: int) -> Json:
    return {
        'type': 'line', 'xref': 'paper', 'x0': 0, 'x1': 1, 'yref': f'y{number}', 'y0': value,
        'y1': value, 'line': {'color': GRAY, 'width': 1, 'dash': 'dot'}, 'layer': 'below',
    }  # fmt: skip


def _shade(interval: Interval) -> Json:
    color, alpha, edge = drawing.SHADES[interval.kind]
    return {
        'type': 'rect', 'xref': 'x', 'x0': interval.start, 'x1': interval.end, 'yref': 'paper',
        'y0': 0, 'y1': 1, 'fillcolor': color, 'opacity': alpha, 'layer': 'below',
        'line': {'color': color, 'width': edge},
    }  # fmt: skip


def _lane_trace(lanes: Mapping[str, Sequence[Interval]]) -> Json:
    """Return the events, whose points the page makes: the hover finds points, not bars."""
    return {
        'intervals': [
            [each.start, each.end, lane, _color(each), _words(each)]
            for lane, intervals in enumerate(lanes.values())
            for each in intervals
        ]
    }


def _color(interval: Interval) -> str:
    if interval.kind is IntervalKind.STATE:
        return drawing.STATE_COLOURS.get(interval.name, GRAY)
    return drawing.SHADES[interval.kind].color


def _words(interval: Interval) -> str:
    name = interval.name.replace('_', ' ')
    return f'{name}: {interval.detail}' if interval.detail else name


def _curve_trace(
    panel: Panel, curve: DrawnCurve, number: int, shown: set[str], numbers: PackedNumbers
) -> Json:
    line = curve.line
    reduced = every_nth if line.dash in POINTS else envelope
    few = reduced(curve.time, {'y': curve.values}, MAX_ROWS)
    value = '' if curve.role is Role.NO_ECHO else f': %{{y:.2~f}} {panel.unit}'
    trace = {
        'type': 'scatter',
        'packed': {'x': numbers.add(few['time_s']), 'y': numbers.add(few['y'])},
        'yaxis': f'y{number}', 'name': line.label, 'legendgroup': line.label,
        'legendrank': 1000 + list(Role).index(curve.role),
        'showlegend': curve.is_named and line.label not in shown,
        'visible': 'legendonly' if curve.role in _HIDDEN_AT_FIRST else True,
        'hovertemplate': f'{curve.words}{value}<extra></extra>',
        **_look(line),
    }  # fmt: skip
    shown.add(line.label)
    return trace


def _look(line: Line) -> Json:
    if line.dash in POINTS:
        symbol = _SYMBOLS[line.dash]
        marker = {'color': line.color, 'size': 1.5 * line.width, 'symbol': symbol}
        return {'mode': 'markers', 'marker': marker}
    return {'mode': 'lines', 'line': stroke(line)}


def stroke(line: Line) -> Json:
    """Return the style of a curve of the page."""
    return {'color': line.color, 'width': line.width, 'dash': _DASHES[line.dash]}


def track_figure(
    tracks: Sequence[tuple[Table, Line]],
    floor: FloorMap | OccupancyGrid | None,
    marks: Sequence[drawing.TrackMark],
    numbers: PackedNumbers,
) -> Json:
    """Return tracks on the map from above, with their ends, pushes and wall hits.

    A track whose line has a label is one of several, see `drawing.draw_track`. A single one has a
    ball, which the page moves.
    """
    # Without walls, the plot may be as wide as the page.
    constrained = 'range' if floor is None else 'domain'
    layout = {
        **chart_layout(),
        'xaxis': {**GRID, 'title': {'text': drawing.X_LABEL}, 'constrain': constrained},
        'yaxis': {
            **GRID, 'title': {'text': drawing.Y_LABEL}, 'scaleanchor': 'x',
            'constrain': constrained,
        },
    }  # fmt: skip
    traces = [_floor_trace(drawing.floor_shades(floor))] if floor is not None else []
    for table, line in tracks:
        traces += _track_traces(table, line, numbers)
    traces += _mark_traces(marks)
    if not any(line.label for _, line in tracks):
        ball = _point('ball', 0.0, 0.0, INK, 'circle-open', 14)
        traces.append({**ball, 'x': [], 'y': [], 'showlegend': False})
    return {'data': traces, 'layout': layout}


def _track_traces(table: Table, line: Line, numbers: PackedNumbers) -> list[Json]:
    """Return a track and its ends, of which those of several tracks have no names."""
    few = every_nth(table['time_s'], {k: v for k, v in table.items() if k != 'time_s'}, MAX_ROWS)
    x, y, time = (few[name] for name in ('map_x_cm', 'map_y_cm', 'time_s'))
    hover = '%{customdata:.3f} s: %{x:.1f} cm forward, %{y:.1f} cm left'
    track = {
        'type': 'scatter',
        'packed': {'x': numbers.add(x), 'y': numbers.add(y), 'customdata': numbers.add(time)},
        'name': line.label or 'track', 'mode': 'lines',
        'hovertemplate': f'{" ".join(filter(None, (line.label, hover)))}<extra></extra>',
        'line': {**stroke(line), 'width': 1.8, 'simplify': False},
    }  # fmt: skip
    ends = [
        _point('start', x[0], y[0], line.color if line.label else GRAY, 'circle', 11),
        _point('end', x[-1], y[-1], line.color if line.label else ORANGE, 'square', 9),
    ]
    return [track, *({**each, 'showlegend': not line.label} for each in ends)]


def _point(name: str, x: float, y: float, color: str, symbol: str, size: float) -> Json:
    return {
        'type': 'scatter', 'mode': 'markers', 'x': [float(x)], 'y': [float(y)], 'name': name,
        'marker': {'color': color, 'symbol': symbol, 'size': size, 'line': {'width': 1}},
        'hovertemplate': f'{name}<extra></extra>',
    }  # fmt: skip


def _mark_traces(marks: Sequence[drawing.TrackMark]) -> list[Json]:
    traces = []
    for kind, marker in drawing.TRACK_MARKERS.items():
        some = [each for each in marks if each.interval.kind is kind]
        if some:
            color = drawing.SHADES[kind].color
            traces.append({
                'type': 'scatter', 'mode': 'markers', 'name': kind.value,
                'x': [each.x for each in some], 'y': [each.y for each in some],
                'text': [f'{each.interval.start:.3f} s: {_words(each.interval)}' for each in some],
                'hovertemplate': '%{text}<extra></extra>',
                'marker': {
                    'color': color, 'symbol': _SYMBOLS[marker], 'size': 11,
                    'line': {'color': color, 'width': 2},
                },
            })  # fmt: skip
    return traces


def _floor_trace(floor: drawing.FloorShades) -> Json:
    """Return walls and lines as an image."""
    rows, columns = floor.shades.shape
    left, right, low, high = floor.extent
    step_x, step_y = (right - left) / columns, (high - low) / rows
    cells = [
        [None if math.isnan(cell) else cell for cell in row] for row in floor.shades[::-1].tolist()
    ]
    return {
        'type': 'heatmap', 'z': cells, 'zmin': drawing.WALL_SHADE, 'zmax': drawing.LINE_SHADE,
        'x0': left + step_x / 2.0,
        'dx': step_x, 'y0': low + step_y / 2.0, 'dy': step_y, 'showscale': False,
        'colorscale': [[0, '#999999'], [1, '#CCCCCC']], 'hoverinfo': 'skip',
    }  # fmt: skip
