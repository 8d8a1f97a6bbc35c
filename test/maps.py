"""Maps drawn by tests."""

import numpy as np
from PIL import Image

from ballbot_ros.robot.world.floor_map import FLOOR, LINE, WALL, FloorMap

SIGNS = {'.': FLOOR, '#': WALL, '-': LINE}


def drawn(*rows):
    """Return the map of rows of text: '.' floor, '#' wall, '-' line."""
    return FloorMap(np.array([[SIGNS[sign] for sign in row] for row in rows], dtype=np.uint8))


def open_floor(rows, columns):
    return FloorMap(np.full((rows, columns), FLOOR, dtype=np.uint8))


def with_walls(rows, columns, *areas):
    """Return a floor with walls in the areas (first row, row after, first column, column after)."""
    cells = np.full((rows, columns), FLOOR, dtype=np.uint8)
    for top, bottom, left, right in areas:
        cells[top:bottom, left:right] = WALL
    return FloorMap(cells)


def save(floor_map, path):
    """Write the map's image and return its path."""
    Image.fromarray(floor_map.cells).save(path)
    return path
