"""Maps of the floor in square cells of 1 cm: shipped ones, and files for other programs."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ballbot_ros.errors import WorldError, os_errors
from ballbot_ros.files import read_bytes, shipped_file, shipped_names
from ballbot_ros.parameters.yaml_document import yaml_text
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
    so that u and v increase with the positions of planes x and y. The cells, shape (rows, columns),
    are :data:`FLOOR`, :data:`WALL` or :data:`LINE`; row 0 is the top of the image.
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
    return shipped_names('maps', MAP_SUFFIXES[0])


def is_file_name(name_or_file: str) -> bool:
    """Return whether a map is given by the path of its image instead of its name."""
    return '/' in name_or_file or name_or_file.lower().endswith(MAP_SUFFIXES)


def map_path(name_or_file: str) -> Path:
    """Return the image of a shipped map or the given path; raise WorldError for an unknown name."""
    if is_file_name(name_or_file):
        return Path(name_or_file)
    return shipped_file(name_or_file, 'maps', 'map', WorldError, MAP_SUFFIXES)


def read_map_file(name_or_file: str) -> bytes:
    """Read the image file of a map unchanged; raise WorldError if it does not exist."""
    path = map_path(name_or_file)
    with os_errors(WorldError, path):
        return read_bytes(path)


def load_map(name_or_file: str) -> FloorMap:
    """Load a shipped map by its name, or an image by its path; raise WorldError if it is no map."""
    # Imported here, so that nodes without a map start faster.
    from ballbot_ros.robot.world.image import read_map

    return read_map(map_path(name_or_file))


def image_suffix(data: bytes) -> str:
    """Return the file name ending that matches the content of a map image."""
    return '.png' if data.startswith(b'\x89PNG') else '.bmp'


WALL_HEIGHT_CM = 20
OCCUPIED, FREE = 100, 0
"""Values of the cells in nav_msgs/OccupancyGrid [%]."""

_PGM_WALL, _PGM_FREE = 0, 254
_HEIGHTS = {FLOOR: '0', LINE: '0', WALL: str(WALL_HEIGHT_CM)}
_COLOURS = {FLOOR: '1 1 1', LINE: '0 0 0', WALL: '.502 .502 .502'}


class OccupancyGrid(NamedTuple):
    """The content of nav_msgs/OccupancyGrid.

    Attributes
    ----------
    width, height : int
        Cells along x and along y.
    resolution : float
        Side of a cell [m].
    origin : tuple of float
        Position of the lower left corner in ``map`` [m], x and y.
    cells : ndarray of int8, shape (height, width)
        :data:`OCCUPIED` or :data:`FREE`; the first row is the one with the smallest y.
    """

    width: int
    height: int
    resolution: float
    origin: tuple[float, float]
    cells: NDArray[np.int8]


def occupancy_grid(floor_map: FloorMap) -> OccupancyGrid:
    """Return the map as an occupancy grid; a black line is free floor."""
    cells = np.where(floor_map.walls[::-1], OCCUPIED, FREE).astype(np.int8)
    return OccupancyGrid(
        floor_map.columns, floor_map.rows, CELL_M, _lower_left_corner(floor_map), cells
    )


def floor_map_of(grid: OccupancyGrid) -> FloorMap:
    """Return the map from which a grid was made; its black lines are lost, being free in a grid."""
    return FloorMap(np.where(grid.cells[::-1] == OCCUPIED, WALL, FLOOR).astype(np.uint8))


def _lower_left_corner(floor_map: FloorMap) -> tuple[float, float]:
    return -floor_map.columns * CELL_M / 2.0, -floor_map.rows * CELL_M / 2.0


def write_files(
    floor_map: FloorMap, *, wrl: Path | None, nav2: Path | None, nodes: str = ''
) -> list[Path]:
    """Write a map as VRML, as nav2's YAML with its image, or as both; return the written files.

    The .pgm is named after the .yaml. `nodes` are more of VRML's, to follow the floor. It raises
    WorldError if a file already exists or can't be written, and then leaves no files.
    """
    for path in filter(None, (wrl, nav2)):
        if path.is_dir() or not path.name:
            raise WorldError(f'{path}: is a folder; name a file')
    contents: dict[Path, Callable[[BinaryIO], None]] = {}
    if wrl is not None:
        contents[wrl] = lambda stream: _write_vrml(floor_map, nodes, stream)
    if nav2 is not None:
        image = nav2.with_suffix('.pgm')
        if image in (nav2, wrl) or nav2 == wrl:
            raise WorldError(
                f'{nav2}: the map server needs a .yaml file, with its .pgm file next to it'
            )
        contents[nav2] = lambda stream: _write_nav2(floor_map, image.name, stream)
        contents[image] = lambda stream: _write_pgm(floor_map, stream)
    _create(contents)
    return list(contents)


def _create(contents: Mapping[Path, Callable[[BinaryIO], None]]) -> None:
    created: list[Path] = []
    try:
        for path, write in contents.items():
            with os_errors(WorldError, path, 'name'), path.open('xb') as stream:
                created.append(path)
                write(stream)
    except WorldError:
        for each in created:
            with suppress(OSError):
                each.unlink()
        raise


def _write_vrml(floor_map: FloorMap, nodes: str, stream: BinaryIO) -> None:
    """Write an elevation grid (Appendix B.2): a vertex per pixel, x the column, z the row [cm]."""

    def write(text: str) -> None:
        stream.write(text.encode())

    def write_cells(words: Mapping[int, str]) -> None:
        # Write row by row: the text, a word for each cell, is ten times as large as the map.
        table = [words.get(value, '') for value in range(FLOOR + 1)]
        for row in floor_map.cells.tolist():
            write(','.join([table[value] for value in row]) + ',\n')

    write(
        '#VRML V2.0 utf8\n'
        f'# Floor of the NXT Ballbot: {floor_map.columns} x {floor_map.rows} cm, y up.\n'
        'Shape {\n'
        '  appearance Appearance { material Material { } }\n'
        '  geometry ElevationGrid {\n'
        f'    xDimension {floor_map.columns}\n    zDimension {floor_map.rows}\n'
        '    xSpacing 1\n    zSpacing 1\n    solid FALSE\n'
        '    height [\n'
    )
    write_cells(_HEIGHTS)
    write('    ]\n    colorPerVertex TRUE\n    color Color { color [\n')
    write_cells(_COLOURS)
    write(f'    ] }}\n  }}\n}}\n{nodes}')


def _write_nav2(floor_map: FloorMap, image: str, stream: BinaryIO) -> None:
    content = {
        'image': image,
        'mode': 'trinary',
        'resolution': CELL_M,
        'origin': [*_lower_left_corner(floor_map), 0.0],
        'negate': 0,
        'occupied_thresh': 0.65,
        'free_thresh': 0.196,
    }
    stream.write(yaml_text(content).encode())


def _write_pgm(floor_map: FloorMap, stream: BinaryIO) -> None:
    # Imported here, so that nodes without a map start faster.
    from PIL import Image

    pixels = np.where(floor_map.walls, _PGM_WALL, _PGM_FREE).astype(np.uint8)
    Image.fromarray(pixels).save(stream, 'PPM')
