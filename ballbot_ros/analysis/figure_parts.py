"""What all figures are made of: their style, tables, intervals of time, and panels."""

from __future__ import annotations

import csv
import io
import textwrap
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from enum import Enum
from functools import cache
from io import BytesIO
from typing import TYPE_CHECKING

import numpy as np

from ballbot_ros.engine.rows import Column
from ballbot_ros.parameters.parameter import TextEnum

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# Okabe and Ito's colours, which colour-blind readers and black-and-white prints can tell apart.
BLUE, ORANGE, GRAY = '#0072B2', '#D55E00', '#666666'
GREEN, SKY, YELLOW, PURPLE = '#009E73', '#56B4E9', '#F0E442', '#CC79A7'

DARKER: Mapping[str, str] = {BLUE: '#003A5C', ORANGE: '#7D2F00'}
"""The colours of thin curves over the wide ones of the planes."""

INK, PAPER = '#1A1A1A', '#FFFFFF'
"""Colours of text, and of what is behind it."""

ON_DARK: Mapping[str, str] = {
    INK: '#E6E8EA',
    PAPER: '#15181B',
    BLUE: '#56B4E9',
    ORANGE: '#FF8F45',
    GRAY: '#A0A4A8',
    GREEN: '#2FC79A',
    SKY: '#8C8CFF',
    PURPLE: '#E29AC2',
    DARKER[BLUE]: '#B5E3FF',
    DARKER[ORANGE]: '#FFD166',
}
"""What stands for a colour on a dark page; other colours stay."""

WIDTH = 8.0
"""Width of a figure on a page [inch]."""

_TITLE_LETTERS_PER_INCH = 11


@dataclass(frozen=True)
class Line:
    """Style of a curve: width [point], a line style of matplotlib, its name in the legend or ''."""

    color: str
    width: float = 1.4
    dash: str = '-'
    label: str = ''


PLANES = (Line(BLUE, label='plane x'), Line(ORANGE, 1.0, '--', 'plane y'))
"""The curves of planes x and y."""


@cache
def _figure_class() -> type[Figure]:
    # Imported here, so that the start of a run does not wait for the import, which takes a second.
    from matplotlib.figure import Figure

    class ShownFigure(Figure):
        """A figure that a notebook shows, whether or not it uses pyplot."""

        _repr_png_ = png_of

    return ShownFigure


def new_figure(width: float, height: float, title: str = '') -> Figure:
    """Return a figure of this size [inch], with its title on as many lines as it needs."""
    figure = _figure_class()(figsize=(width, height), layout='constrained')
    if title:
        letters = int(width * _TITLE_LETTERS_PER_INCH)
        figure.suptitle(textwrap.fill(title, letters, break_on_hyphens=False))
    return figure


def png_of(figure: Figure) -> bytes:
    """Return a figure as the content of a PNG file."""
    from matplotlib.text import Text

    for text in figure.findobj(Text):
        # Show a $ in user-defined names as it is; no figure has a formula.
        text.set_parse_math(False)
    buffer = BytesIO()
    figure.savefig(buffer, dpi=150)
    return buffer.getvalue()


class IntervalKind(TextEnum):
    """What an interval is about."""

    STATE = 'state'
    STICKS = 'sticks'
    PUSH = 'push'
    WALL_HIT = 'wall hit'
    PROPERTY = 'property'
    FAULT = 'fault'


@dataclass(frozen=True)
class Interval:
    """A named interval of time [s]; `detail` is a description, or ''."""

    start: float
    end: float
    name: str
    kind: IntervalKind = IntervalKind.STATE
    detail: str = ''


MAX_FIGURE_ROWS = 20_000
"""Maximum number of rows (80 s of ticks) that a figure shows one by one."""

_ROWS_PER_INTERVAL = 4
"""Minimum number of rows that become the two of an interval."""

Table = Mapping[str, Column]
"""Columns of equal length by name; the first one is the time [s]."""


def plane_columns(name: str, unit: str, values: Column) -> dict[str, Column]:
    """Return the columns for values of both planes, shape (n, 2), by name."""
    return {f'{name}_x_{unit}': values[:, 0], f'{name}_y_{unit}': values[:, 1]}


def track_columns(position: Column) -> dict[str, Column]:
    """Return the track in ``map`` [cm] for positions in the planes [m], (n, 2)."""
    x, y = position.T * 100.0
    return {'map_x_cm': x, 'map_y_cm': -y}


def envelope(time: Column, columns: Mapping[str, Column], max_rows: int = MAX_FIGURE_ROWS) -> Table:
    """Return a table of the columns; more than `max_rows` are reduced to extremes of intervals.

    Each interval then has two rows, with the minimum and the maximum of each column. A line through
    them covers the same area as a line through all rows.
    """
    if len(time) <= max_rows:
        return {'time_s': time, **columns}
    intervals = max_rows // _ROWS_PER_INTERVAL
    bounds = np.linspace(0, len(time), intervals + 1).astype(int)[:-1]
    table = {'time_s': np.repeat(time[bounds], 2)}
    table['time_s'][1::2] += np.diff(time[bounds], append=time[-1]) / 2.0
    for name, values in columns.items():
        table[name] = np.empty(2 * intervals)
        table[name][0::2] = np.fmin.reduceat(values, bounds)
        table[name][1::2] = np.fmax.reduceat(values, bounds)
    return table


def every_nth(
    time: Column, columns: Mapping[str, Column], max_rows: int = MAX_FIGURE_ROWS
) -> Table:
    """Return a table of the columns; many rows are reduced to every nth and the last."""
    if len(time) <= max_rows:
        return {'time_s': time, **columns}
    stride = -(-len(time) // max_rows)
    rows = np.unique(np.append(np.arange(0, len(time), stride), len(time) - 1))
    return {'time_s': time[rows], **{name: values[rows] for name, values in columns.items()}}


def csv_of(table: Table) -> bytes:
    """Return a table as CSV; a missing number is an empty field."""
    rows = zip(*(values.tolist() for values in table.values()), strict=True)
    return csv_text(list(table), ([_text(value) for value in row] for row in rows))


def csv_text(header: Sequence[str], rows: Iterable[Sequence[str]]) -> bytes:
    """Return a header and rows as CSV."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator='\n')
    writer.writerow(header)
    writer.writerows(rows)
    return text.getvalue().encode()


def _text(value: float | str) -> str:
    if isinstance(value, str):
        return value
    return '' if value != value else f'{value:.9g}'


NO_ECHO_CM = 255.0
"""Where a measurement without an echo is drawn [cm]: the number that the sensor then returns."""


class Role(Enum):
    """What a curve is, in the order of every legend: its label, and the width and dash of its line.

    Only one of several curves is `TRUE`. `select` returns the values to draw of a column.
    """

    TRUE = 'true', 2.2
    COMMANDED = 'commanded', 1.2, ':'
    REFERENCE = 'reference', 0.9, '--'
    ESTIMATED = 'estimated', 0.9, '--'
    READING = 'reading − offset', 0.9, '--'
    OFFSET = 'offset', 0.9, '--'
    MEASURED = ('',)
    ECHO = 'echo', 3.0, '.', lambda values: np.where(np.isfinite(values), values, np.nan)
    NO_ECHO = 'no echo', 4.0, '|', lambda values: np.where(np.isinf(values), NO_ECHO_CM, np.nan)
    EARLIER = 'earlier run', 1.0, ':'

    def __init__(
        self,
        label: str,
        width: float = 1.4,
        dash: str = '-',
        select: Callable[[Column], Column] = lambda values: values,
    ) -> None:
        self.label, self.width, self.dash, self.select = label, width, dash, select


POINTS = ('.', '|')
"""Dashes that are points instead of a line; the width is their size."""


@dataclass(frozen=True)
class Curve:
    """A column of a table, of plane ``x`` or ``y`` or, if it is '', of no plane."""

    column: str
    role: Role = Role.TRUE
    plane: str = ''

    def line(self) -> Line:
        """Return its line next to the curves of the same plane only."""
        color = ORANGE if self.plane == 'y' or self.role is Role.NO_ECHO else BLUE
        if self.plane and self.role is not Role.TRUE:
            color = DARKER[color]
        return Line(color, self.role.width, self.role.dash, self.role.label)

    def line_of_both(self) -> Line:
        """Return its line next to the curves of the other plane."""
        is_main = self.plane and self.role is Role.TRUE
        return PLANES['xy'.index(self.plane)] if is_main else self.line()


@dataclass(frozen=True)
class DrawnCurve:
    """The numbers of a curve against time, and how it is drawn and named.

    Attributes
    ----------
    time, values : ndarray, shape (n,)
    words : str
        What the page says of it, before the value.
    plane : str
        ``x``, which is drawn in front, ``y``, or '' for no plane.
    is_named : bool
        Whether it has an entry in the page's legend.
    """

    time: Column
    values: Column
    line: Line
    words: str
    role: Role = Role.TRUE
    plane: str = ''
    is_named: bool = True


@dataclass(frozen=True)
class Row:
    """A panel with its numbers, as both pictures and pages draw it."""

    panel: Panel
    curves: tuple[DrawnCurve, ...]


@dataclass(frozen=True)
class Panel:
    """Curves of one quantity on one pair of axes.

    Attributes
    ----------
    label : str
        The quantity and its unit in brackets, as ``body pitch [°]``.
    min_span : float
        What the vertical axis spans at least, so that small changes look small.
    limits : tuple of float
        Values at which there is a dotted line.
    bounds : tuple of float or None
        The ends of the vertical axis; None if the curves decide.
    scale : float
        Factor from the unit of the columns to that of the label.
    """

    label: str
    curves: tuple[Curve, ...]
    min_span: float = 0.0
    limits: tuple[float, ...] = ()
    bounds: tuple[float, float] | None = None
    scale: float = 1.0

    def only(self, *roles: Role) -> Panel:
        """Return the panel with the curves of some roles only."""
        return replace(self, curves=tuple(each for each in self.curves if each.role in roles))

    def of_plane(self, plane: str) -> Panel:
        """Return the panel with the curves of one plane only, which its label names."""
        quantity, bracket, unit = self.label.partition(' [')
        curves = tuple(each for each in self.curves if each.plane == plane)
        return replace(self, label=f'{quantity} {plane}{bracket}{unit}', curves=curves)

    @property
    def quantity(self) -> str:
        """The label without the unit."""
        return self.label.partition(' [')[0]

    @property
    def unit(self) -> str:
        """The unit."""
        return self.label.partition('[')[2].rstrip(']')

    def row(self, table: Table, line_of: Callable[[Curve], Line] = Curve.line_of_both) -> Row:
        """Return the panel with the curves that have a value in a table."""
        curves, time = [], table['time_s']
        for each in self.curves:
            values, role, plane = table[each.column] * self.scale, each.role, each.plane
            if not np.isnan(values).all():
                label = '' if role is Role.TRUE else role.label
                words = ' '.join(filter(None, (self.quantity, plane, label)))
                drawn = role.select(values), line_of(each), words, role, plane, bool(plane)
                curves.append(DrawnCurve(time, *drawn))
        return Row(self, tuple(curves))


def panel_of_planes(
    label: str, curves: Iterable[tuple[Role, str]], scale: float = 1.0, min_span: float = 0.0
) -> Panel:
    """Return a panel with curves of both planes; {} in a column stands for the plane."""
    both = ((role, column, plane) for role, column in curves for plane in 'xy')
    every = (Curve(column.format(plane), role, plane) for role, column, plane in both)
    return Panel(label, tuple(every), min_span, scale=scale)


def with_earlier(
    panels: Iterable[Panel], table: Table, earlier: Table
) -> tuple[tuple[Panel, ...], Table]:
    """Return panels and their table with the same curves of an earlier run, by its table."""
    columns, shown = dict(table), []
    for panel in panels:
        curves = list(panel.curves)
        for own in panel.curves:
            curves.append(replace(own, column=f'earlier_{own.column}', role=Role.EARLIER))
            columns[curves[-1].column] = np.interp(
                table['time_s'], earlier['time_s'], earlier[own.column], right=np.nan
            )
        shown.append(replace(panel, curves=tuple(curves)))
    return tuple(shown), columns
