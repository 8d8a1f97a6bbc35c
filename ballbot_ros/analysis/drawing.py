"""Elements of figures: curves against time, and the track on the floor.

The picture of a run, the report and the comparison share these functions, so that they look alike.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ballbot_ros.analysis.interval import Interval
from ballbot_ros.analysis.style import GRAY, ORANGE, PLANES, Line
from ballbot_ros.analysis.table import Table, plane_columns
from ballbot_ros.world.exports import OccupancyGrid
from ballbot_ros.world.floor_map import CELL_M, LINE, WALL, FloorMap

if TYPE_CHECKING:
    from matplotlib.axes import Axes

# Lighter grays than those of map images, so that the track stands out.
_WALL_SHADE, _LINE_SHADE = 0.6, 0.8

_LINES = 2.0
"""Matplotlib's default z-order of lines."""

_OCCUPIED_PERCENT = 50
"""Occupancy from which a cell of a grid is drawn as wall."""


@dataclass(frozen=True)
class Quantity:
    """A quantity with a column for each plane.

    Its name is that of its figure and of its columns, which end in the unit.
    """

    name: str
    suffix: str
    label: str

    def column(self, plane: str) -> str:
        """Return the column name of plane ``x`` or ``y``."""
        return f'{self.name}_{plane}_{self.suffix}'

    def columns(self, values: NDArray[Any]) -> dict[str, NDArray[Any]]:
        """Return the columns for values of both planes, shape (n, 2), by name."""
        return plane_columns(self.name, self.suffix, values)


POSITION = Quantity('position', 'cm', 'position [cm]')
PITCH = Quantity('pitch', 'deg', 'body pitch [°]')
DUTY = Quantity('duty', 'percent', 'duty [%]')


def draw_planes(axes: Axes, quantity: Quantity, table: Table) -> None:
    """Draw a quantity of both planes against time, plane x in front of plane y."""
    for plane, line, height in zip('xy', PLANES, (_LINES + 0.1, _LINES), strict=True):
        draw_line(axes, table['time_s'], table[quantity.column(plane)], line, height)
    frame_curves(axes, quantity.label)


def draw_line(
    axes: Axes, x: NDArray[Any], y: NDArray[Any], line: Line, height: float = _LINES
) -> None:
    """Draw a line through points, each of shape (n,), in front of earlier ones.

    `height` is the z-order: higher lines cover lower ones.
    """
    axes.plot(
        x, y, color=line.color, linewidth=line.width, linestyle=line.dash,
        label=line.label or None, zorder=height,
    )  # fmt: skip


def frame_curves(axes: Axes, label: str) -> None:
    """Set up axes for curves against time; `label` is for the vertical axis."""
    axes.margins(x=0.0)
    axes.set_ylabel(label)
    style_axes(axes)


def label_time(axes: Axes) -> None:
    """Label the horizontal axis as time."""
    axes.set_xlabel('time [s]')


def shade_intervals(axes: Axes, intervals: Iterable[Interval]) -> None:
    """Shade intervals of time."""
    for interval in intervals:
        axes.axvspan(interval.start, interval.end, color=GRAY, alpha=0.12, linewidth=0.0)


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


def draw_floor(axes: Axes, floor: FloorMap | OccupancyGrid | None) -> None:
    """Draw the floor from above, in the axes of ``map``, with forward on the right.

    A map has walls and lines, a grid only walls; None is an empty floor.
    """
    if isinstance(floor, FloorMap):
        _draw_map(axes, floor)
    elif floor is not None:
        _draw_grid(axes, floor)
    axes.set_aspect('equal', adjustable='datalim' if floor is None else 'box')
    axes.set_xlabel('x of map, forward [cm]')
    axes.set_ylabel('y of map, left [cm]')
    style_axes(axes)


def _draw_map(axes: Axes, floor_map: FloorMap) -> None:
    shades = np.full(floor_map.cells.shape, np.nan)
    shades[floor_map.cells == WALL] = _WALL_SHADE
    shades[floor_map.cells == LINE] = _LINE_SHADE
    right, top = (n * CELL_M * 100.0 / 2.0 for n in (floor_map.columns, floor_map.rows))
    _draw_shades(axes, shades, (-right, right, -top, top))


def _draw_grid(axes: Axes, grid: OccupancyGrid) -> None:
    shades = np.where(grid.cells[::-1] >= _OCCUPIED_PERCENT, _WALL_SHADE, np.nan)
    left, low = (edge * 100.0 for edge in grid.origin)
    height, width = (cells * grid.resolution * 100.0 for cells in grid.cells.shape)
    _draw_shades(axes, shades, (left, left + width, low, low + height))


def _draw_shades(
    axes: Axes, shades: NDArray[np.float64], extent: tuple[float, float, float, float]
) -> None:
    """Draw gray values between 0 and 1, and nothing for NaN; `extent` is in cm."""
    axes.imshow(
        np.ma.masked_invalid(shades), cmap='gray', vmin=0.0, vmax=1.0, interpolation='nearest',
        extent=extent,
    )  # fmt: skip


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


def legend_above(axes: Axes, columns: int = 2) -> None:
    """Put the legend above the axes, on the right."""
    axes.legend(loc='lower right', bbox_to_anchor=(1.0, 1.0), ncols=columns, frameon=False)


def legend_below(axes: Axes, columns: int = 2) -> None:
    """Put the legend below the axes, on the right, next to the axis label."""
    axes.legend(loc='upper right', bbox_to_anchor=(1.0, -0.2), ncols=columns, frameon=False)


def style_axes(axes: Axes) -> None:
    """Draw a faint grid, and remove the frame where there is no axis."""
    axes.grid(alpha=0.3)
    axes.spines[['top', 'right']].set_visible(False)
