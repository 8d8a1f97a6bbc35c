"""Distance from the body's outline to the nearest wall.

numba can compile :func:`clearance` without changes.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from ballbot_ros.robot.arithmetic import Floats
from ballbot_ros.robot.world.floor_map import CELL_M, CELLS_PER_METRE, FloorMap

_ROUNDING = 1e-9
"""More than the rounding of positions [cells]."""


class Walls(NamedTuple):
    """The distances to the walls of a map, for a body of one size; lengths in cells.

    The upright body covers a rectangle of cells, some of them partly. Their number along an axis
    differs with the position, but two blocks of a fixed number cover all of them: one begins with
    the first cell, the other ends with the last.

    Attributes
    ----------
    distance : ndarray, shape (rows + rows of a block - 1, columns + columns of a block - 1)
        Distance from a block of cells to the edge of the nearest wall cell, 0 if a cell of the
        block is a wall. The block of element (i, j) ends with row i and column j, and has only
        cells of the map.
    rows, columns : int
        Size of the map.
    half_u, half_v : float
        Half of the body's depth and width.
    """

    distance: Floats
    rows: int
    columns: int
    half_u: float
    half_v: float


NO_WALLS = Walls(np.zeros((0, 0)), 0, 0, 0.0, 0.0)
"""No map, or a map without walls."""


def walls_around(floor_map: FloorMap, half_u: float, half_v: float) -> Walls:
    """Return the walls of a map for a body of these half sizes [cells].

    They are :data:`NO_WALLS` if the map has none.
    """
    # Imported here, so that nodes without a map start faster.
    from scipy.ndimage import distance_transform_edt

    free = ~floor_map.walls
    if free.all():
        return NO_WALLS
    # Subtract half a cell: the transform is the distance to the centre of the nearest wall cell,
    # whose edge is nearer.
    distance = np.maximum(distance_transform_edt(free) - 0.5, 0.0)
    for axis, half in enumerate((half_v, half_u)):
        # The body covers this number of cells or more, also after rounding.
        block = max(math.ceil(2.0 * half - _ROUNDING), 1)
        margin = [(0, 0), (0, 0)]
        margin[axis] = (block - 1, block - 1)
        padded = np.pad(distance, margin, constant_values=np.inf)
        distance = sliding_window_view(padded, block, axis).min(axis=-1)
    return Walls(distance, floor_map.rows, floor_map.columns, half_u, half_v)


def clearance(walls: Walls, positions: Floats) -> Floats:
    """Return the distances [m] from the outline to the nearest wall, (n,), at positions (n, 2).

    Positions are those of the ball's centre [m] in plane signs. The distances are exact to about
    1 cm: 0 if the body is in a wall, inf if there are no walls, a lower bound if the outline is
    off the map, NaN at a position of NaN.
    """
    if walls.distance.size == 0:
        return np.full(len(positions), np.inf)
    u = positions[:, 0] * CELLS_PER_METRE + walls.columns / 2.0
    v = positions[:, 1] * CELLS_PER_METRE + walls.rows / 2.0
    left, right = u - walls.half_u, u + walls.half_u
    top, bottom = v - walls.half_v, v + walls.half_v
    height, width = walls.distance.shape
    from_left = _nearest_index(np.floor(left) + (width - walls.columns), width)
    to_right = _nearest_index(np.floor(right), width)
    from_top = _nearest_index(np.floor(top) + (height - walls.rows), height) * width
    to_bottom = _nearest_index(np.floor(bottom), height) * width
    # Flat, because numba indexes with only one array.
    distance = walls.distance.ravel()
    upper = np.minimum(distance[from_top + from_left], distance[from_top + to_right])
    lower = np.minimum(distance[to_bottom + from_left], distance[to_bottom + to_right])
    on_map = np.minimum(upper, lower)
    # For a body off the map, add the distances to the edge and from there to a wall as a right
    # angle: the map is convex, so no wall is nearer.
    off_u = np.maximum(np.maximum(left - walls.columns, -right), 0.0)
    off_v = np.maximum(np.maximum(top - walls.rows, -bottom), 0.0)
    nearest: Floats = np.sqrt(on_map * on_map + off_u * off_u + off_v * off_v) * CELL_M
    return nearest


def _nearest_index(numbers: Floats, size: int) -> NDArray[np.int64]:
    """Return the whole numbers as indices of an axis of this size, at its ends if beyond them."""
    # Unlike maximum and minimum, fmax and fmin turn NaN into a number, which is a valid index.
    return np.fmin(np.fmax(numbers, 0.0), size - 1.0).astype(np.int64)
