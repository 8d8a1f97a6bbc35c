"""Walls and lines as rectangles."""

import numpy as np
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays
from laws import given

from ballbot_ros.viewer.floor import lines, walls
from ballbot_ros.world.floor_map import CELL_M, FLOOR, LINE, WALL, FloorMap

maps = arrays.arrays(
    np.uint8, st.tuples(st.integers(1, 12), st.integers(1, 12)), elements=st.sampled_from(
        [FLOOR, WALL, LINE]
    )
)  # fmt: skip


def painted(floor_map, rectangles):
    """Return the number of rectangles that cover each cell."""
    count = np.zeros_like(floor_map.cells, int)
    for left, bottom, right, top in rectangles:
        columns = [round(x / CELL_M + floor_map.columns / 2) for x in (left, right)]
        rows = [round(floor_map.rows / 2 - y / CELL_M) for y in (top, bottom)]
        count[slice(*rows), slice(*columns)] += 1
    return count


@given(maps)
def test_rectangles_cover_every_wall_and_line_once_and_nothing_else(cells):
    floor_map = FloorMap(cells)
    assert (painted(floor_map, walls(floor_map)) == (cells == WALL)).all()
    assert (painted(floor_map, lines(floor_map)) == (cells == LINE)).all()
