"""Maps of the floor in square cells of 1 cm: the shipped ones, and files."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ballbot_ros.errors import WorldError, did_you_mean
from ballbot_ros.files import read_bytes, share_directory
from ballbot_ros.robot.plant.ground_truth import Pair

FLOOR, WALL, LINE = 255, 128, 0
"""Gray values of the map image (Appendix B.2)."""

CELL_M = 0.01
CELLS_PER_METRE = 100.0


def map_point(columns: int, rows: int, position: Pair) -> Pair:
    """Return the point (u, v) [cells] of a position [m] in plane signs on a map of this size."""
    return (
        position[0] * CELLS_PER_METRE + columns / 2.0,
        position[1] * CELLS_PER_METRE + rows / 2.0,
    )


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
        return map_point(self.columns, self.rows, position)

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


MAP_SUFFIXES = ('.png', '.bmp')


def map_names() -> list[str]:
    """Return the names of the shipped maps."""
    return sorted(path.stem for path in _folder().glob('*.png'))


def is_file_name(name_or_file: str) -> bool:
    """Return whether a map is given by the path of its image instead of its name."""
    return '/' in name_or_file or name_or_file.lower().endswith(MAP_SUFFIXES)


def map_path(name_or_file: str) -> Path:
    """Return the image of a shipped map or the given path; raise WorldError for an unknown name."""
    if is_file_name(name_or_file):
        return Path(name_or_file)
    if name_or_file in map_names():
        return _folder() / f'{name_or_file}.png'
    raise WorldError(
        f'unknown map {name_or_file!r}{did_you_mean(name_or_file, map_names())}; '
        f'shipped: {", ".join(map_names())} '
        '(for your own map, give the path of its file, ending in .png or .bmp)'
    )


def read_map_file(name_or_file: str) -> bytes:
    """Read the image file of a map unchanged; raise WorldError if it does not exist."""
    path = map_path(name_or_file)
    try:
        return read_bytes(path)
    except OSError as error:
        raise WorldError(f'{path}: {error.strerror}') from None


def load_map(name_or_file: str) -> FloorMap:
    """Load a shipped map by its name, or an image by its path; raise WorldError if it is no map."""
    # Imported here, so that nodes without a map start faster.
    from ballbot_ros.robot.world.image import read_map

    return read_map(map_path(name_or_file))


def image_suffix(data: bytes) -> str:
    """Return the file name ending that matches the content of a map image."""
    return '.png' if data.startswith(b'\x89PNG') else '.bmp'


def _folder() -> Path:
    return share_directory() / 'config/maps'
