"""The world of the plant: a map, and the robot's body on it."""

from __future__ import annotations

import math
from functools import cached_property
from typing import Any, NamedTuple, Protocol, cast

import numpy as np

from ballbot_ros.errors import WorldError
from ballbot_ros.parameters import PlantParameters
from ballbot_ros.robot.plant.ground_truth import Pair
from ballbot_ros.robot.world.clearance import Walls, walls_around
from ballbot_ros.robot.world.floor_map import CELL_M, CELLS_PER_METRE, FloorMap, load_map, map_point
from ballbot_ros.robot.world.sonar_beam import wall_distance


class Cells(Protocol):
    """A table of the cells of a map, an array or its memory, shape (rows, columns)."""

    @property
    def shape(self) -> tuple[int, ...]:
        """Rows and columns."""
        ...

    def __len__(self) -> int: ...
    def __getitem__(self, at: tuple[int, int], /) -> int: ...


class Footprint(NamedTuple):
    """The map's walls and the body's outline, for :func:`is_blocked`; lengths are in cells.

    Attributes
    ----------
    sides : array of int32, shape (rows, columns)
        Result of :func:`~ballbot_ros.robot.world.sonar_beam.wall_distance`.
    walls_before : array of int32, shape (rows + 1, columns + 1)
        Number of wall cells above and to the left of each corner of a cell.
    half_u, half_v : float
        Half of the body's depth and width.
    """

    sides: Cells
    walls_before: Cells
    half_u: float
    half_v: float


def half_cells(length: float) -> float:
    """Return half of a length [m] in cells."""
    return length * CELLS_PER_METRE / 2.0


def is_blocked(footprint: Footprint, position: Pair) -> bool:
    """Return whether any part of the body is in a wall; the position is the ball's centre [m].

    Four prefix sums give the number of wall cells in a rectangle, so that no wall, however narrow,
    can slip between the points of the outline.
    """
    sides, walls_before, half_u, half_v = footprint
    rows, columns = sides.shape
    u, v = map_point(columns, rows, position)
    # Where the ball is far from all walls, the body can't reach one.
    if 0.0 <= u < columns and 0.0 <= v < rows and sides[int(v), int(u)] > max(half_u, half_v) + 1.0:
        return False
    left = min(max(math.floor(u - half_u), 0), columns)
    right = min(max(math.floor(u + half_u) + 1, 0), columns)
    top = min(max(math.floor(v - half_v), 0), rows)
    bottom = min(max(math.floor(v + half_v) + 1, 0), rows)
    inside = (
        walls_before[bottom, right] - walls_before[top, right]
        - walls_before[bottom, left] + walls_before[top, left]
    )  # fmt: skip
    return bool(inside > 0)


class World:
    """A floor with walls, and the outline of the upright body: a rectangle around the ball.

    Only walls block the robot; the floor off the map is free. Positions are those of the ball's
    centre [m] in plane signs (docs/frames.md). The body's depth and width [m] are along x and y.
    The `footprint` has walls and outline as numbers, in memory views.
    """

    def __init__(self, floor_map: FloorMap, body_depth: float, body_width: float) -> None:
        self.map = floor_map
        self._half_u, self._half_v = half_cells(body_depth), half_cells(body_width)
        sums = np.zeros((floor_map.rows + 1, floor_map.columns + 1), dtype=np.int32)
        np.cumsum(np.cumsum(floor_map.walls, axis=0, dtype=np.int32), axis=1, out=sums[1:, 1:])
        sides = wall_distance(floor_map)
        # Memory views give their elements faster than arrays do.
        tables = cast(Cells, sides.data), cast(Cells, sums.data)
        self.footprint = Footprint(*tables, self._half_u, self._half_v)
        self._points = {
            f'{end} {side}': (along * self._half_u, across * self._half_v)
            for end, along in (('front', 1.0), ('rear', -1.0))
            for side, across in (('left', -1.0), ('middle', 0.0), ('right', 1.0))
        }

    @classmethod
    def of(cls, parameters: PlantParameters) -> World | None:
        """Create the world described by the parameters of ``plant_sim``; None without a ``map``.

        It raises WorldError if the map can't be read, or the start position is blocked.
        """
        if not parameters.map:
            return None
        world = cls(load_map(parameters.map), parameters.body_depth, parameters.body_width)
        world.check_start((parameters.start_position_x, parameters.start_position_y))
        return world

    @property
    def walls_as_numbers(self) -> tuple[Any, Any]:
        """The two tables of the footprint."""
        return self.footprint.sides, self.footprint.walls_before

    def check_start(self, position: Pair) -> None:
        """Raise WorldError if a start position is off the map or puts the body in a wall."""
        x, y = position[0], -position[1] + 0.0
        where = f'the start position x {x:g} m, y {y:g} m (map)'
        if not self.map.contains(self.map.point(position)):
            x_end, y_end = self.map.columns * CELL_M / 2.0, self.map.rows * CELL_M / 2.0
            raise WorldError(f'{where} is off the map, which spans x ±{x_end:g} m, y ±{y_end:g} m')
        if self.blocked(position):
            raise WorldError(
                f'{where} puts the body in a wall: {", ".join(self.touching(position))}'
            )

    def blocked(self, position: Pair) -> bool:
        """Return whether any part of the body is in a wall, see :func:`is_blocked`."""
        return is_blocked(self.footprint, position)

    def touching(self, position: Pair) -> tuple[str, ...]:
        """Return which of the document's six points of the outline are in a wall (B.3).

        They are such as 'front left'; 'between two points of the outline' if none of the points is
        in the wall; empty if the body is not in a wall.
        """
        if not self.blocked(position):
            return ()
        u, v = self.map.point(position)
        names = tuple(
            name
            for name, (along, across) in self._points.items()
            if self.map.is_wall((u + along, v + across))
        )
        return names or ('between two points of the outline',)

    @cached_property
    def walls(self) -> Walls:
        """The distances from the body to the walls."""
        # Not computed for every run: a node needs no clearance.
        return walls_around(self.map, self._half_u, self._half_v)
