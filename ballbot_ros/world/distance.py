"""Distance along a ray to the next wall: the document's steps, and exactly.

Origins are points (u, v) of the map in cells, directions are angles [rad] from +u towards +v, and
distances are in cells, that is in centimetres. Where the ray leaves the map or goes further than
the reach without a wall, the distance is inf; a ray that begins in a wall has distance 0, and one
that begins off the map sees nothing.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from ballbot_ros.numerics.elementary import sine_cosine
from ballbot_ros.plant.truth import Pair
from ballbot_ros.world.floor_map import FloorMap

REACH = 255
"""Where the document's steps end [cells]: an unsigned byte of centimetres."""

Ray = Callable[[Pair, float], float]
"""(origin, direction) -> distance."""


def wall_distance(floor_map: FloorMap) -> NDArray[np.int32]:
    """Return the chessboard distance [cells] from each cell to the nearest wall.

    Returns
    -------
    ndarray, shape (rows, columns)
        0 in a wall; without any wall, more than from side to side.
    """
    # Here, so that the nodes of a run without a map start sooner.
    from scipy.ndimage import distance_transform_cdt

    free = ~floor_map.walls
    if free.all():
        return np.full(free.shape, max(free.shape), dtype=np.int32)
    return np.ascontiguousarray(distance_transform_cdt(free, 'chessboard'), dtype=np.int32)


def stepped_ray(floor_map: FloorMap) -> Ray:
    """Return the document's search (Appendix B.3): steps of 1 cm until a point is in a wall.

    A step can jump over the corner of a wall. The distance is a whole number.
    """
    walls = floor_map.walls.data
    columns, rows = floor_map.columns, floor_map.rows

    def distance(origin: Pair, direction: float) -> float:
        u, v = origin
        dv, du = sine_cosine(direction)
        for step in range(REACH):
            column, row = math.floor(u + step * du), math.floor(v + step * dv)
            if not (0 <= column < columns and 0 <= row < rows):
                return math.inf
            if walls[row, column]:
                return float(step)
        return math.inf

    return distance


def exact_ray(floor_map: FloorMap) -> Ray:
    """Return a search from cell to cell that leaps over squares in which there is no wall.

    The chessboard distance from each cell to the nearest wall tells the largest such square about
    it. Next to a wall the square is the cell itself, and the leap a step of the cell traversal
    of Amanatides and Woo (1987). All points are reckoned from the origin, so errors do not add
    up.
    """
    columns, rows = floor_map.columns, floor_map.rows
    sides = wall_distance(floor_map).data

    def distance(origin: Pair, direction: float) -> float:
        u, v = origin
        dv, du = sine_cosine(direction)
        column, row = math.floor(u), math.floor(v)
        travelled = 0.0
        while travelled < REACH and 0 <= column < columns and 0 <= row < rows:
            side = sides[row, column]
            if side == 0:
                return travelled
            edge_u = column + side if du > 0.0 else column - side + 1
            edge_v = row + side if dv > 0.0 else row - side + 1
            to_u = (edge_u - u) / du if du else math.inf
            to_v = (edge_v - v) / dv if dv else math.inf
            # The other coordinate stays within the square, whatever the rounding says.
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

    return distance


RAYS: dict[str, Callable[[FloorMap], Ray]] = {'exact': exact_ray, 'stepped': stepped_ray}
"""The values of the parameter ``distance_model``."""
