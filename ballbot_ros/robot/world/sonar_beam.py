"""The field of view of the ultrasonic sensor: a ray along +x of ``map``, or a fan of rays.

The sensor is in the centre of the upright body's front face: the robot has no yaw, and its pitch is
neglected. Without a map there are no walls.

Origins are points (u, v) of the map in cells, directions are angles [rad] from +u towards +v, and
distances are in cells, that is in centimetres. The distance is inf if the ray leaves the map or
exceeds its reach without meeting a wall, or begins off the map; it is 0 if the ray begins in a
wall.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ballbot_ros.errors import WorldError
from ballbot_ros.parameters import SonarParameters
from ballbot_ros.robot.arithmetic import sine_cosine
from ballbot_ros.robot.plant.ground_truth import Pair
from ballbot_ros.robot.world.floor_map import FloorMap, load_map

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
        Result of :func:`~ballbot_ros.robot.world.sonar_beam.wall_distance`.
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

    It raises WorldError if the map can't be read, or ``cone_rays`` is an even number.
    """
    check_rays(parameters)
    # The interpreter gets the elements of a memory view faster than those of an array.
    return wall_distance(load_map(parameters.map)).data if parameters.map else ()
