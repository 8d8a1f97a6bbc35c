"""The field of view of the ultrasonic sensor on the front face."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from ballbot_ros.parameters import SonarParameters
from ballbot_ros.plant.ground_truth import Pair
from ballbot_ros.world.distance import exact_distance, stepped_distance, wall_distance
from ballbot_ros.world.errors import WorldError
from ballbot_ros.world.floor_map import CELL_M
from ballbot_ros.world.library import load_map


def beam_directions(cone_angle: float, cone_rays: int) -> list[float]:
    """Return the directions [rad] of the rays of a cone; it has one if its angle [rad] is 0."""
    count = cone_rays if cone_angle else 1
    middle = count // 2
    return [
        cone_angle * (index - middle) / (count - 1) if index != middle else 0.0
        for index in range(count)
    ]


def nearest_echo(sides: Any, origin: Pair, directions: Sequence[float], exact: bool) -> float:
    """Return the shortest distance [cells] along some rays, inf if none meets a wall.

    Parameters
    ----------
    sides : array of int32
        Result of :func:`~ballbot_ros.world.distance.wall_distance`.
    origin : tuple of float
        The sensor's point on the map (u, v) [cells].
    directions : sequence of float
        Directions of the rays [rad].
    exact : bool
        Whether the distance is exact, or found in the document's steps.
    """
    nearest = math.inf
    for direction in directions:
        if exact:
            nearest = min(nearest, exact_distance(sides, origin, direction))
        else:
            nearest = min(nearest, stepped_distance(sides, origin, direction))
    return nearest


class SonarBeam:
    """A single ray along +x of ``map``, or a fan of rays, of which the nearest echo counts.

    The sensor is in the centre of the upright body's front face: the robot has no yaw, and its
    pitch is neglected. Without a parameter ``map`` there are no walls.

    Raises
    ------
    WorldError
        If the map can't be read, or ``cone_rays`` is an even number.
    """

    def __init__(self, parameters: SonarParameters) -> None:
        self._to_front: float = parameters.body_depth / 2.0
        if parameters.cone_rays % 2 == 0:
            raise WorldError(
                f'sonar_driver.cone_rays: {parameters.cone_rays} is even; '
                'only an odd number has a ray that points straight ahead'
            )
        self._directions = beam_directions(parameters.cone_angle, parameters.cone_rays)
        self._map = load_map(parameters.map) if parameters.map else None
        if self._map is not None:
            self._exact = parameters.distance_model == 'exact'
            self._sides = wall_distance(self._map).data  # faster than the elements of an array

    def distance_m(self, position: Pair) -> float:
        """Return the distance [m] from the sensor to the nearest wall, inf if there is none.

        `position` is the ball's centre [m], in plane signs.
        """
        if self._map is None:
            return math.inf
        origin = self._map.point((position[0] + self._to_front, position[1]))
        return CELL_M * nearest_echo(self._sides, origin, self._directions, self._exact)
