"""Distances on the floor: along the beam of the sonar, and from the body to the nearest wall.

The sonar is in the centre of the upright body's front face: the robot has no yaw, and its pitch is
neglected. Without a map there are no walls.

Origins are points (u, v) of the map in cells, directions are angles [rad] from +u towards +v, and
distances are in cells, that is in centimetres. The distance is inf if the ray leaves the map or
exceeds its reach without meeting a wall, or begins off the map; it is 0 if the ray begins in a
wall.

numba can compile :func:`clearance` without changes.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from ballbot_ros.errors import WorldError
from ballbot_ros.parameters import SonarParameters
from ballbot_ros.robot.numerics.elementary import sine_cosine
from ballbot_ros.robot.plant.ground_truth import Pair
from ballbot_ros.robot.world.floor_map import CELL_M, CELLS_PER_METRE, FloorMap, load_map

MAX_RAY_CELLS = 255
"""Length of the document's search [cells]: an unsigned byte of centimetres."""


def wall_distance(floor_map: FloorMap) -> NDArray[np.int32]:
    """Return the chessboard distance [cells] from each cell to the nearest wall, (rows, columns).

    It is 0 in a wall; without walls, it is the longer side of the map in every cell.
    """
    # Imported here, so that nodes without a map start faster.
    from scipy.ndimage import distance_transform_cdt

    free = ~floor_map.walls
    if free.all():
        return np.full(free.shape, max(free.shape), dtype=np.int32)
    return np.ascontiguousarray(distance_transform_cdt(free, 'chessboard'), dtype=np.int32)


def stepped_distance(sides: Any, origin: Pair, direction: float) -> float:
    """Return the distance by the document's search (Appendix B.3).

    It takes steps of 1 cm until a point is in a wall, so it can skip the corner of a wall. The
    distance is a whole number. `sides` is the result of :func:`wall_distance`.
    """
    rows, columns = sides.shape
    u, v = origin
    dv, du = sine_cosine(direction)
    for step in range(MAX_RAY_CELLS):
        column, row = math.floor(u + step * du), math.floor(v + step * dv)
        if not (0 <= column < columns and 0 <= row < rows):
            return math.inf
        if sides[row, column] == 0:
            return float(step)
    return math.inf


def exact_distance(sides: Any, origin: Pair, direction: float) -> float:
    """Return the distance by a search from cell to cell that skips squares without walls.

    `sides`, the result of :func:`wall_distance`, gives the largest such square around each cell.
    Next to a wall the square is the cell itself, and the search is the cell traversal of Amanatides
    and Woo (1987). All points are computed from the origin, so that errors do not accumulate.
    """
    rows, columns = sides.shape
    u, v = origin
    dv, du = sine_cosine(direction)
    column, row = math.floor(u), math.floor(v)
    travelled = 0.0
    while travelled < MAX_RAY_CELLS and 0 <= column < columns and 0 <= row < rows:
        side = sides[row, column]
        if side == 0:
            return travelled
        edge_u = column + side if du > 0.0 else column - side + 1
        edge_v = row + side if dv > 0.0 else row - side + 1
        to_u = (edge_u - u) / du if du else math.inf
        to_v = (edge_v - v) / dv if dv else math.inf
        # Clamp the other coordinate to the square, against rounding.
        if to_u <= to_v:
            travelled = to_u
            last = row
            column = edge_u if du > 0.0 else edge_u - 1
            row = min(max(math.floor(v + travelled * dv), last - side + 1), last + side - 1)
        else:
            travelled = to_v
            last = column
            row = edge_v if dv > 0.0 else edge_v - 1
            column = min(max(math.floor(u + travelled * du), last - side + 1), last + side - 1)
    return math.inf


def nearest_echo(sides: Any, origin: Pair, cone_angle: float, rays: int, is_exact: bool) -> float:
    """Return the shortest distance [cells] along the rays of a cone, inf if none meets a wall.

    Parameters
    ----------
    sides : array of int32
        Result of :func:`~ballbot_ros.robot.world.distances.wall_distance`.
    origin : tuple of float
        The sensor's point on the map (u, v) [cells].
    cone_angle : float
        Angle between the outer rays [rad].
    rays : int
        Their number, which is odd: one points straight ahead.
    is_exact : bool
        Whether the distance is exact, or found in the document's steps.
    """
    nearest, middle = math.inf, rays // 2
    for ray in range(rays):
        direction = cone_angle * (ray - middle) / (rays - 1) if ray != middle else 0.0
        if is_exact:
            nearest = min(nearest, exact_distance(sides, origin, direction))
        else:
            nearest = min(nearest, stepped_distance(sides, origin, direction))
    return nearest


def check_rays(parameters: SonarParameters) -> None:
    """Raise WorldError if ``cone_rays`` is an even number."""
    if parameters.cone_rays % 2 == 0:
        raise WorldError(
            f'sonar_driver.cone_rays: {parameters.cone_rays} is even; '
            'only an odd number has a ray that points straight ahead'
        )


def sides_of(parameters: SonarParameters) -> Any:
    """Return the distances of a sonar's map to its walls, see `nearest_echo`; () without a map.

    Raises
    ------
    WorldError
        If the map can't be read, or ``cone_rays`` is an even number.
    """
    check_rays(parameters)
    # The interpreter gets the elements of a memory view faster than those of an array.
    return wall_distance(load_map(parameters.map)).data if parameters.map else ()


Floats = NDArray[np.float64]

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
    from_left = nearest_index(np.floor(left) + (width - walls.columns), width)
    to_right = nearest_index(np.floor(right), width)
    from_top = nearest_index(np.floor(top) + (height - walls.rows), height) * width
    to_bottom = nearest_index(np.floor(bottom), height) * width
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


def nearest_index(numbers: Floats, size: int) -> NDArray[np.int64]:
    """Return the whole numbers as indices of an axis of this size, at its ends if beyond them."""
    # Unlike maximum and minimum, fmax and fmin turn NaN into a number, which is a valid index.
    return np.fmin(np.fmax(numbers, 0.0), size - 1.0).astype(np.int64)
