"""The walls as rectangles, and the extent of the floor."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ballbot_ros.robot.world.floor_map import CELL_M, FloorMap

FREE_HALF_SIDE = 1.0
"""Half the side of the square shown of an unlimited floor [m]."""

Rectangle = tuple[float, float, float, float]
"""Lowest x and y, highest x and y in ``map`` [m]."""


@dataclass(frozen=True)
class Area:
    """Centre and half sides of the part of the floor in the fixed views [m]."""

    middle: tuple[float, float]
    half_x: float
    half_y: float

    @classmethod
    def of(cls, floor_map: FloorMap | None, start: tuple[float, float] = (0.0, 0.0)) -> Area:
        """Return the map, or a square around `start` (x, y in ``map``) on an unlimited floor."""
        if floor_map is None:
            return cls(start, FREE_HALF_SIDE, FREE_HALF_SIDE)
        return cls((0.0, 0.0), floor_map.columns * CELL_M / 2, floor_map.rows * CELL_M / 2)


def walls(floor_map: FloorMap) -> list[Rectangle]:
    """Return the walls as rectangles that do not overlap."""
    return list(_rectangles(floor_map, floor_map.walls))


def _rectangles(floor_map: FloorMap, mask: NDArray[np.bool_]) -> Iterator[Rectangle]:
    """Yield rectangles made of equal runs of cells in consecutive rows."""
    open_runs: dict[tuple[int, int], int] = {}
    blank = np.zeros((1, mask.shape[1]), bool)
    for row, cells in enumerate(np.vstack([mask, blank])):
        edges = np.flatnonzero(np.diff(cells, prepend=False, append=False))
        runs = set(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))
        for run in [run for run in open_runs if run not in runs]:
            top = open_runs.pop(run)
            yield (
                (run[0] - floor_map.columns / 2.0) * CELL_M,
                (floor_map.rows / 2.0 - row) * CELL_M,
                (run[1] - floor_map.columns / 2.0) * CELL_M,
                (floor_map.rows / 2.0 - top) * CELL_M,
            )
        for run in runs:
            open_runs.setdefault(run, row)
