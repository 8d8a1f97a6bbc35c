"""The field of view of the ultrasonic sensor: a ray along +x of ``map``, or a fan of rays.

The sensor is in the centre of the upright body's front face: the robot has no yaw, and its pitch is
neglected. Without a map there are no walls.
"""

from __future__ import annotations

import math
from typing import Any

from ballbot_ros.parameters import SonarParameters
from ballbot_ros.plant.ground_truth import Pair
from ballbot_ros.world.distance import exact_distance, stepped_distance, wall_distance
from ballbot_ros.world.errors import WorldError
from ballbot_ros.world.library import load_map


def nearest_echo(sides: Any, origin: Pair, cone_angle: float, rays: int, is_exact: bool) -> float:
    """Return the shortest distance [cells] along the rays of a cone, inf if none meets a wall.

    Parameters
    ----------
    sides : array of int32
        Result of :func:`~ballbot_ros.world.distance.wall_distance`.
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
