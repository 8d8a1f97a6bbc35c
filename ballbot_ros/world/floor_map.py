"""A map of the floor in square cells of 1 cm, and their positions in the world."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ballbot_ros.plant.ground_truth import Pair

FLOOR, WALL, LINE = 255, 128, 0
"""Gray values of the map image (Appendix B.2)."""

CELL_M = 0.01
CELLS_PER_METRE = 100.0


@dataclass(frozen=True)
class FloorMap:
    """The type of each square centimetre of the floor.

    Points are in cells from the top left corner of the image: u to the right, v downwards. The
    centre of the image is the origin of ``map``, right is forward (+x) and down is rightward (-y),
    so that u and v increase with the positions of planes x and y.

    Attributes
    ----------
    cells : ndarray of uint8, shape (rows, columns)
        :data:`FLOOR`, :data:`WALL` or :data:`LINE`; row 0 is the top of the image.
    """

    cells: NDArray[np.uint8]

    @property
    def rows(self) -> int:
        """Number of cells from the left side (+y) to the right side (-y)."""
        return int(self.cells.shape[0])

    @property
    def columns(self) -> int:
        """Number of cells from the rear (-x) to the front (+x)."""
        return int(self.cells.shape[1])

    @property
    def walls(self) -> NDArray[np.bool_]:
        """The cells that are walls, shape (rows, columns)."""
        return np.equal(self.cells, WALL)

    def point(self, position: Pair) -> Pair:
        """Return the point (u, v) [cells] of a position [m] in plane signs."""
        return (
            position[0] * CELLS_PER_METRE + self.columns / 2.0,
            position[1] * CELLS_PER_METRE + self.rows / 2.0,
        )

    def points(self, positions: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the points of many positions, each of shape (n, 2)."""
        return positions * CELLS_PER_METRE + np.array([self.columns, self.rows]) / 2.0

    def contains(self, point: Pair) -> bool:
        """Return whether a point (u, v) [cells] is on the map."""
        return 0.0 <= point[0] < self.columns and 0.0 <= point[1] < self.rows

    def is_wall(self, point: Pair) -> bool:
        """Return whether a point (u, v) [cells] is in a wall; there are no walls off the map."""
        return self.contains(point) and bool(
            self.cells[math.floor(point[1]), math.floor(point[0])] == WALL
        )


def wall_sums(floor_map: FloorMap) -> NDArray[np.int32]:
    """Return the number of wall cells above and left of each corner, (rows + 1, columns + 1)."""
    sums = np.zeros((floor_map.rows + 1, floor_map.columns + 1), dtype=np.int32)
    np.cumsum(np.cumsum(floor_map.walls, axis=0, dtype=np.int32), axis=1, out=sums[1:, 1:])
    return sums


def walls_in_rectangle(
    sums: NDArray[np.int32] | memoryview, left: int, right: int, top: int, bottom: int
) -> int:
    """Return the number of wall cells in the columns from `left` and the rows from `top`.

    Parameters
    ----------
    sums : ndarray of int32, shape (rows + 1, columns + 1)
        From :func:`wall_sums`; Python reads single elements faster from its memoryview.
    right, bottom : int
        The first column and row behind the rectangle.
    """
    inside: int = sums[bottom, right] - sums[top, right] - sums[bottom, left] + sums[top, left]
    return inside
