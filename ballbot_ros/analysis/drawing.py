"""Pictures by matplotlib: curves against time, the track on the floor, the figure of a run.

The picture of a run, the report and the comparison share these functions, so that they look alike.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ballbot_ros.analysis.figure_parts import (
    BLUE,
    GRAY,
    GREEN,
    ORANGE,
    POINTS,
    PURPLE,
    SKY,
    WIDTH,
    YELLOW,
    Interval,
    IntervalKind,
    Line,
    Panel,
    Role,
    Row,
    Table,
    new_figure,
    track_columns,
    with_earlier,
)
from ballbot_ros.analysis.panels import DUTY, TRUE_PITCH, TRUE_POSITION, motion_columns
from ballbot_ros.controllers.interface import OperatingState
from ballbot_ros.engine.scenario.scenario import Segment
from ballbot_ros.engine.trajectory import Trajectory
from ballbot_ros.robot.arithmetic import Floats
from ballbot_ros.robot.world.floor_map import CELL_M, LINE, WALL, FloorMap, OccupancyGrid

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, SubFigure

# Lighter grays than those of map images, so that the track stands out.
WALL_SHADE, LINE_SHADE = 0.6, 0.8
"""Gray values of walls and lines, from 0 for black to 1 for white."""

_LINES = 2.0
"""Matplotlib's default z-order of lines."""

_OCCUPIED_PERCENT = 50
"""Occupancy from which a cell of a grid is drawn as wall."""


class Shade(NamedTuple):
    """How an interval is shaded: colour, opacity, and width of its edge [point].

    The edge lets a short interval be seen.
    """

    color: str
    alpha: float = 0.12
    edge: float = 0.0


SHADES: Mapping[IntervalKind, Shade] = {
    IntervalKind.STATE: Shade(GRAY),
    IntervalKind.STICKS: Shade(GRAY),
    IntervalKind.PUSH: Shade(PURPLE, 0.3, 0.8),
    IntervalKind.WALL_HIT: Shade(ORANGE, 0.25, 0.8),
    IntervalKind.PROPERTY: Shade(GREEN, 0.7, 1.2),
    IntervalKind.FAULT: Shade(PURPLE, 0.12, 0.8),
}


def draw_line(axes: Axes, x: Floats, y: Floats, line: Line, height: float = _LINES) -> None:
    """Draw a line through points, each of shape (n,), in front of earlier ones.

    `height` is the z-order: higher lines cover lower ones.
    """
    is_point = line.dash in POINTS
    axes.plot(
        x, y, color=line.color, linewidth=line.width, linestyle='' if is_point else line.dash,
        marker=line.dash if is_point else '', markersize=line.width,
        label=line.label or None, zorder=height,
    )  # fmt: skip


def draw_row(axes: Axes, row: Row) -> None:
    """Draw curves against time, plane x in front of plane y, an earlier run behind both."""
    for curve in row.curves:
        height = _LINES + 0.1 * (curve.plane == 'x') - 0.5 * (curve.role is Role.EARLIER)
        draw_line(axes, curve.time, curve.values, curve.line, height)
    for limit in row.panel.limits:
        axes.axhline(limit, color=GRAY, linewidth=0.8, linestyle=':')
    frame_curves(axes, row.panel.label)
    if row.panel.bounds:
        axes.set_ylim(*row.panel.bounds)


def frame_curves(axes: Axes, label: str) -> None:
    """Set up axes for curves against time; `label` is for the vertical axis."""
    axes.margins(x=0.0)
    axes.set_ylabel(label)
    style_axes(axes)


def draw_rows(rows: Sequence[Row], marked: Sequence[Interval] = ()) -> Figure:
    """Draw rows one above the other, with marked intervals shaded, and the others named."""
    figure = new_figure(WIDTH, 2.8 if len(rows) == 1 else 2.5 * len(rows))
    lines = _stack(figure, rows, marked, [1] * len(rows))
    name_intervals(lines[0], [each for each in marked if each.kind is not IntervalKind.STATE])
    if len(lines[0].get_legend_handles_labels()[0]) > 1:
        legend_above(lines[0])
    return figure


def _stack(
    figure: Figure | SubFigure,
    rows: Sequence[Row],
    marked: Sequence[Interval],
    heights: Sequence[int],
) -> Sequence[Axes]:
    lines = figure.subplots(len(rows), sharex=True, squeeze=False, height_ratios=heights)[:, 0]
    for axes, row in zip(lines, rows, strict=True):
        draw_row(axes, row)
        if not row.panel.bounds:
            set_min_span(axes, row.panel.min_span)
        shade_intervals(axes, marked)
    label_time(lines[-1])
    return list(lines)


def label_time(axes: Axes) -> None:
    """Label the horizontal axis as time."""
    axes.set_xlabel('time [s]')


def shade_intervals(axes: Axes, intervals: Iterable[Interval]) -> None:
    """Shade intervals of time in the colour of what happens; a short one is still to be seen."""
    for each in intervals:
        color, alpha, edge = SHADES[each.kind]
        axes.axvspan(each.start, each.end, color=color, alpha=alpha, linewidth=edge)


def name_intervals(axes: Axes, intervals: Iterable[Interval]) -> None:
    """Write the names of intervals above the axes, but not across an earlier interval's name.

    Call it last: the range of the axes decides which names have room.
    """
    names = [
        axes.annotate(
            interval.name, ((interval.start + interval.end) / 2.0, 1.0), (0, 3), color=GRAY,
            fontsize='small', xycoords=('data', 'axes fraction'), textcoords='offset points',
            ha='center', parse_math=False,
        )
        for interval in intervals
    ]  # fmt: skip
    axes.get_xlim()  # Updates the range. The layout, to come, only widens the axes.
    extents = [name.get_window_extent() for name in names]
    for index, name in enumerate(names):
        if any(extents[index].overlaps(earlier) for earlier in extents[:index]):
            name.remove()


def set_min_span(axes: Axes, span: float) -> None:
    """Let the vertical axis span at least `span`, so that small changes look small."""
    low, high = axes.get_ylim()
    middle, half = (low + high) / 2.0, max(high - low, span) / 2.0
    axes.set_ylim(middle - half, middle + half)


@dataclass(frozen=True)
class FloorShades:
    """The floor from above.

    Attributes
    ----------
    shades : ndarray, shape (rows, columns)
        Gray values between 0 and 1, NaN for nothing; the first row is that of the largest y.
    extent : tuple of float
        The smallest and largest x, and the smallest and largest y, in ``map`` [cm].
    """

    shades: NDArray[np.float64]
    extent: tuple[float, float, float, float]


def floor_shades(floor: FloorMap | OccupancyGrid) -> FloorShades:
    """Return the floor from above: a map with its walls and lines, a grid with its walls."""
    if isinstance(floor, FloorMap):
        shades = np.full(floor.cells.shape, np.nan)
        shades[floor.cells == WALL] = WALL_SHADE
        shades[floor.cells == LINE] = LINE_SHADE
        right, top = (n * CELL_M * 100.0 / 2.0 for n in (floor.columns, floor.rows))
        return FloorShades(shades, (-right, right, -top, top))
    shades = np.where(floor.cells[::-1] >= _OCCUPIED_PERCENT, WALL_SHADE, np.nan)
    left, low = (edge * 100.0 for edge in floor.origin)
    height, width = (cells * floor.resolution * 100.0 for cells in floor.cells.shape)
    return FloorShades(shades, (left, left + width, low, low + height))


X_LABEL, Y_LABEL = 'x of map, forward [cm]', 'y of map, left [cm]'


def draw_floor(axes: Axes, floor: FloorMap | OccupancyGrid | None) -> None:
    """Draw the floor from above, in the axes of ``map``, with forward on the right.

    None is an empty floor.
    """
    if floor is not None:
        seen = floor_shades(floor)
        axes.imshow(
            np.ma.masked_invalid(seen.shades), cmap='gray', vmin=0.0, vmax=1.0,
            interpolation='nearest', extent=seen.extent,
        )  # fmt: skip
    axes.set_aspect('equal', adjustable='datalim' if floor is None else 'box')
    axes.set_xlabel(X_LABEL)
    axes.set_ylabel(Y_LABEL)
    style_axes(axes)


# Row of the table, name, marker, size, colour and colour of the edge. The square is smaller and has
# a white edge: both marks stay visible in one place and one colour.
_ENDS = ((0, 'start', 'o', 8.0, GRAY, None), (-1, 'end', 's', 6.5, ORANGE, 'white'))


def draw_track(axes: Axes, table: Table, line: Line) -> None:
    """Draw a table of ``track_columns``, with a dot at its start and a square at its end.

    If the line has a label, because it is one of several, dot and square have its colour. If not,
    they have their own colours and entries in the legend.
    """
    x, y = table['map_x_cm'], table['map_y_cm']
    draw_line(axes, x, y, line)
    for row, name, marker, size, color, edge in _ENDS:
        axes.plot(
            x[row], y[row], marker=marker, markersize=size, linestyle='',
            color=line.color if line.label else color, markeredgecolor=edge,
            label=None if line.label else name,
        )  # fmt: skip


STATE_COLOURS: Mapping[str, str] = dict(
    zip(OperatingState, (GRAY, BLUE, GREEN, SKY, YELLOW, PURPLE, ORANGE), strict=True)
)
"""The colours of the operating states; gray for a state of another controller."""

TRACK_MARKERS: Mapping[IntervalKind, str] = {IntervalKind.WALL_HIT: 'x', IntervalKind.PUSH: '^'}
"""What marks the beginning of an interval on the track."""


class TrackMark(NamedTuple):
    """Where the ball was when something began: the interval, and x and y in ``map`` [cm]."""

    interval: Interval
    x: float
    y: float


def draw_marks(axes: Axes, marks: Iterable[TrackMark]) -> None:
    """Draw marks on the track, each kind with one entry in the legend."""
    for kind, marker in TRACK_MARKERS.items():
        points = [(x, y) for interval, x, y in marks if interval.kind is kind]
        if points:
            axes.plot(
                *zip(*points, strict=True), marker=marker, markersize=7.0, linestyle='',
                color=SHADES[kind].color, label=kind.value, zorder=_LINES + 0.5,
            )  # fmt: skip


def legend_above(axes: Axes, columns: int = 2) -> None:
    """Put the legend above the axes, on the right."""
    axes.legend(loc='lower right', bbox_to_anchor=(1.0, 1.0), ncols=columns, frameon=False)


def style_axes(axes: Axes) -> None:
    """Draw a faint grid, and remove the frame where there is no axis."""
    axes.grid(alpha=0.3)
    axes.spines[['top', 'right']].set_visible(False)


def draw_tracks(
    tracks: Iterable[tuple[Table, Line]],
    floor: FloorMap | OccupancyGrid | None,
    marks: Iterable[TrackMark] = (),
) -> Figure:
    """Draw tracks on the map from above, as `interactive.track_figure` does on a page."""
    figure = new_figure(WIDTH, 5.0)
    axes = figure.subplots()
    draw_floor(axes, floor)
    for table, line in tracks:
        draw_track(axes, table, line)
    draw_marks(axes, marks)
    # Start, end and two kinds of marks, or the long names of runs.
    legend_above(axes, 2 if any(line.label for _, line in tracks) else 4)
    return figure


MIN_TRACK_RANGE_CM = 5.0
"""Range of the motion in plane y above which the picture shows the track, too."""


def draw_motion(
    trajectory: Trajectory,
    title: str,
    hold_time: float,
    segments: Iterable[Segment] = (),
    floor: FloorMap | OccupancyGrid | None = None,
    marked: Iterable[Interval] = (),
    earlier: Trajectory | None = None,
) -> Figure:
    """Draw position, pitch and duty, if known, against time, as in figures 8-2 and 8-3.

    With a map, or if the ball moves in both planes, the track is drawn next to them. The gyro
    calibration, up to `hold_time` [s], is shaded, and so are the segments of the sticks and the
    `marked` intervals, such as pushes; all are named where there is room. The curves of an
    `earlier` run, of which it is a branch, are thin.
    """
    position = trajectory.position
    with_track = len(position) > 0 and (
        floor is not None or np.ptp(position[:, 1]) * 100.0 > MIN_TRACK_RANGE_CM
    )
    figure = new_figure(12.0 if with_track else WIDTH, 6.0, title)
    history: Figure | SubFigure = figure
    if with_track:
        history, beside = np.asarray(figure.subfigures(1, 2, width_ratios=(8, 5)))
        track = beside.subplots()
        draw_floor(track, floor)
        if earlier is not None:
            before = track_columns(earlier.position)
            line = Line(GRAY, Role.EARLIER.width, Role.EARLIER.dash, Role.EARLIER.label)
            draw_line(track, before['map_x_cm'], before['map_y_cm'], line)
        draw_track(track, track_columns(position), Line(BLUE))
        legend_above(track)
    panels: tuple[Panel, ...] = TRUE_POSITION, TRUE_PITCH, DUTY
    panels, table = panels[: 2 if np.isnan(trajectory.duty).all() else 3], _table(trajectory)
    if earlier is not None:
        panels, table = with_earlier(panels, table, _table(earlier))
    shaded = _intervals(trajectory, hold_time, segments, marked)
    lines = _stack(history, [each.row(table) for each in panels], shaded, (3, 3, 2)[: len(panels)])
    name_intervals(lines[0], shaded)
    # Below the axes, on the right, next to the axis label.
    lines[-1].legend(loc='upper right', bbox_to_anchor=(1.0, -0.2), ncols=2, frameon=False)
    return figure


def _intervals(
    trajectory: Trajectory,
    hold_time: float,
    segments: Iterable[Segment],
    marked: Iterable[Interval],
) -> list[Interval]:
    """Return the intervals to shade, within the recorded ticks."""
    last = float(trajectory.time[-1]) if len(trajectory.time) else 0.0
    intervals = [Interval(0.0, hold_time, 'calibration')]
    intervals += marked
    intervals += [
        Interval(each.start, each.end, each.name, IntervalKind.STICKS) for each in segments
    ]
    return [
        replace(each, end=min(each.end, last))
        for each in intervals
        if each.start < min(each.end, last)
    ]


def _table(trajectory: Trajectory) -> Table:
    return {'time_s': trajectory.time, **motion_columns(trajectory)}
