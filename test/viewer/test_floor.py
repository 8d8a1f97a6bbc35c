"""Walls as rectangles, and smooth lines."""

import numpy as np
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays
from laws import given

from ballbot_ros.robot.world.floor_map import CELL_M, FLOOR, LINE, WALL, FloorMap
from ballbot_ros.viewer.markers import walls
from ballbot_ros.viewer.shapes import line_mesh

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
def test_rectangles_cover_every_wall_once_and_nothing_else(cells):
    floor_map = FloorMap(cells)
    assert (painted(floor_map, walls(floor_map)) == (cells == WALL)).all()


def covered(floor_map, mesh):
    """Return for each cell whether a triangle covers its centre."""
    vertices, faces = mesh
    column = np.arange(floor_map.columns) + 0.5 - floor_map.columns / 2
    row = floor_map.rows / 2 - np.arange(floor_map.rows) - 0.5
    x, y = np.meshgrid(CELL_M * column, CELL_M * row)
    found = np.zeros(floor_map.cells.shape, bool)
    for a, b, c in vertices[faces][:, :, :2]:
        sides = [
            (q[0] - p[0]) * (y - p[1]) - (q[1] - p[1]) * (x - p[0])
            for p, q in ((a, b), (b, c), (c, a))
        ]
        found |= np.all(np.array(sides) >= -1e-12, 0) | np.all(np.array(sides) <= 1e-12, 0)
    return found


@given(maps)
def test_drawn_lines_cover_the_centres_of_their_cells_and_of_no_others(cells):
    mesh = line_mesh(FloorMap(cells))
    if mesh is None:
        assert not (cells == LINE).any()
    else:
        assert (covered(FloorMap(cells), mesh) == (cells == LINE)).all()


def test_the_steps_of_a_diagonal_line_are_drawn_straight():
    cells = np.full((60, 60), FLOOR, np.uint8)
    column = np.arange(60)
    for width in range(4):
        cells[column // 3 + 20 + width, column] = LINE
    vertices, _ = line_mesh(FloorMap(cells))
    inner = vertices[np.abs(vertices[:, 0]) < 0.2]
    # Distance from a line with the slope of the steps, in cells.
    height = (inner[:, 1] + inner[:, 0] / 3.0) / CELL_M / np.hypot(1.0, 1.0 / 3.0)
    upper = height[height > height.max() - 0.5]
    assert np.ptp(upper) < 0.15
