"""What figures consist of: curves against time, and the track on the floor.

The picture of a run, the report and the comparison draw with these functions, so that the same
thing looks the same everywhere.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ballbot_ros.analysis.style import GRAY, ORANGE, PLANES, Line
from ballbot_ros.analysis.table import Table, plane_columns
from ballbot_ros.world.exports import OccupancyGrid
from ballbot_ros.world.floor_map import CELL_M, LINE, WALL, FloorMap

if TYPE_CHECKING:
    from matplotlib.axes import Axes

# In lighter grays than an image of a map has, so that the track stands out.
_WALL_SHADE, _LINE_SHADE = 0.6, 0.8

_LINES = 2.0
"""The height at which matplotlib draws lines."""

_OCCUPIED_PERCENT = 50
"""From which on a cell of a grid is drawn as wall."""


@dataclass(frozen=True)
class Quantity:
    """A quantity that has a column for each plane.

    Attributes
    ----------
    name : str
        What its columns and its figure are called.
    suffix : str
        What the names of its columns end with: its unit.
    label : str
        What stands at its axis.
    """

    name: str
    suffix: str
    label: str

    def column(self, plane: str) -> str:
        """Return the name of the column of plane ``x`` or ``y``."""
        return f'{self.name}_{plane}_{self.suffix}'

    def columns(self, values: NDArray[Any]) -> dict[str, NDArray[Any]]:
        """Return the columns of values of both planes, shape (n, 2), by their names."""
        return plane_columns(self.name, self.suffix, values)


POSITION = Quantity('position', 'cm', 'position [cm]')
PITCH = Quantity('pitch', 'deg', 'body pitch [°]')
DUTY = Quantity('duty', 'percent', 'duty [%]')


@dataclass(frozen=True)
class Span:
    """A stretch of time [s] with a name."""

    start: float
    end: float
    name: str


def draw_planes(axes: Axes, quantity: Quantity, table: Table) -> None:
    """Draw a quantity of both planes against time, plane x over plane y."""
    for plane, line, height in zip('xy', PLANES, (_LINES + 0.1, _LINES), strict=True):
        draw_line(axes, table['time_s'], table[quantity.column(plane)], line, height)
    frame_curves(axes, quantity.label)


def draw_line(
    axes: Axes, x: NDArray[Any], y: NDArray[Any], line: Line, height: float = _LINES
) -> None:
    """Draw a line through points, over those before it.

    Parameters
    ----------
    axes : matplotlib Axes
    x, y : ndarray, shape (n,)
    line : Line
    height : float
        What is higher is drawn over what is lower.
    """
    axes.plot(
        x, y, color=line.color, linewidth=line.width, linestyle=line.dash,
        label=line.label or None, zorder=height,
    )  # fmt: skip


def frame_curves(axes: Axes, label: str) -> None:
    """Make the axes those of curves against time; `label` stands at the vertical one."""
    axes.margins(x=0.0)
    axes.set_ylabel(label)
    tidy(axes)


def label_time(axes: Axes) -> None:
    """Make the horizontal axis that of time."""
    axes.set_xlabel('time [s]')


def draw_bounds(axes: Axes, bounds: Iterable[float]) -> None:
    """Draw dotted lines at values that the curves can't exceed."""
    for bound in bounds:
        axes.axhline(bound, color=GRAY, linewidth=0.8, linestyle=':')


def shade(axes: Axes, spans: Iterable[Span]) -> None:
    """Shade stretches of time."""
    for span in spans:
        axes.axvspan(span.start, span.end, color=GRAY, alpha=0.12, linewidth=0.0)


def name_spans(axes: Axes, spans: Iterable[Span]) -> None:
    """Write the names of stretches of time above the axes."""
    for span in spans:
        axes.annotate(
            span.name, ((span.start + span.end) / 2.0, 1.0), (0, 3), color=GRAY, fontsize='small',
            xycoords=('data', 'axes fraction'), textcoords='offset points', ha='center',
        )  # fmt: skip


def widen(axes: Axes, least: float) -> None:
    """Let the vertical axis span at least so much: what hardly changes is shown as such."""
    low, high = axes.get_ylim()
    middle, half = (low + high) / 2.0, max(high - low, least) / 2.0
    axes.set_ylim(middle - half, middle + half)


def draw_floor(axes: Axes, floor: FloorMap | OccupancyGrid | None) -> None:
    """Make the axes those of the floor seen from above, forward to the right, as in ``map``.

    Parameters
    ----------
    axes : matplotlib Axes
    floor : FloorMap, OccupancyGrid or None
        Walls, and the lines that a map has and a grid lacks; None for a floor without.
    """
    if isinstance(floor, FloorMap):
        _draw_map(axes, floor)
    elif floor is not None:
        _draw_grid(axes, floor)
    axes.set_aspect('equal', adjustable='datalim' if floor is None else 'box')
    axes.set_xlabel('x of map, forward [cm]')
    axes.set_ylabel('y of map, left [cm]')
    tidy(axes)


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
    """Draw grays between 0 and 1, nothing where there is NaN; the edges in cm."""
    axes.imshow(
        np.ma.masked_invalid(shades), cmap='gray', vmin=0.0, vmax=1.0, interpolation='nearest',
        extent=extent,
    )  # fmt: skip


def draw_track(axes: Axes, table: Table, line: Line) -> None:
    """Draw the way of the ball, a dot where it starts and a square where it ends.

    Where the line has a label, and is one of several, dot and square have its colour; else they
    are named in the legend.

    Parameters
    ----------
    axes : matplotlib Axes
    table : Table
        With the columns ``map_x_cm`` and ``map_y_cm``.
    line : Line
    """
    x, y = table['map_x_cm'], table['map_y_cm']
    draw_line(axes, x, y, line)
    for end in (_START, _END):
        axes.plot(
            x[end.row], y[end.row], marker=end.marker, markersize=end.size, linestyle='',
            color=line.color if line.label else end.color, markeredgecolor=end.edge,
            label=None if line.label else end.name,
        )  # fmt: skip


@dataclass(frozen=True)
class _EndMark:
    """How an end of a track is marked, which is in a row of its table."""

    row: int
    name: str
    marker: str
    size: float
    color: str
    edge: str | None = None


# Both can be seen where the ball comes back to its start, also in one colour.
_START, _END = _EndMark(0, 'start', 'o', 8.0, GRAY), _EndMark(-1, 'end', 's', 6.5, ORANGE, 'white')


def legend_above(axes: Axes, columns: int = 2) -> None:
    """Put the legend above the axes, at their right, where it hides nothing."""
    axes.legend(loc='lower right', bbox_to_anchor=(1.0, 1.0), ncols=columns, frameon=False)


def legend_below(axes: Axes, columns: int = 2) -> None:
    """Put the legend below the axes, at the right of what is written there."""
    axes.legend(loc='upper right', bbox_to_anchor=(1.0, -0.2), ncols=columns, frameon=False)


def tidy(axes: Axes) -> None:
    """Draw a faint grid, and no frame where there is no axis."""
    axes.grid(alpha=0.3)
    axes.spines[['top', 'right']].set_visible(False)
