"""The map for other programs."""

import re

import numpy as np
import pytest
import yaml
from hypothesis import strategies as st
from laws import given
from maps import drawn
from PIL import Image

from ballbot_ros.errors import WorldError
from ballbot_ros.robot.world.floor_map import (
    FLOOR,
    FREE,
    LINE,
    OCCUPIED,
    WALL,
    FloorMap,
    floor_map_of,
    load_map,
    occupancy_grid,
    write_files,
)

PICTURE = drawn('.#-', '##.')


def numbers_after(text, word):
    """Return the numbers of the VRML list that follows a word."""
    content = re.search(rf'\b{word} \[([^\]]*)\]', text)[1]
    return [float(number) for number in re.split(r'[\s,]+', content) if number]


def field(text, word):
    return float(re.search(rf'\b{word} (\S+)', text)[1])


@pytest.mark.parametrize('floor_map', [PICTURE, load_map('track')], ids=['small', 'track'])
def test_vrml_has_a_vertex_a_pixel_with_height_and_colour(tmp_path, floor_map):
    path = tmp_path / 'map.wrl'
    assert write_files(floor_map, wrl=path, nav2=None) == [path]
    text = path.read_text(encoding='utf-8')
    assert text.startswith('#VRML V2.0 utf8\n')
    assert text.count('{') == text.count('}')
    assert text.count('[') == text.count(']')
    rows, columns = floor_map.cells.shape
    assert (field(text, 'xDimension'), field(text, 'zDimension')) == (columns, rows)
    assert field(text, 'xSpacing') == field(text, 'zSpacing') == 1.0
    # The height of vertex (column i, row j) is entry i + j columns.
    heights = np.array(numbers_after(text, 'height')).reshape(rows, columns)
    np.testing.assert_array_equal(heights, np.where(floor_map.walls, 20.0, 0.0))
    colours = np.array(numbers_after(text, 'color')).reshape(rows, columns, 3)
    np.testing.assert_array_equal(np.rint(colours[..., 0] * 255), floor_map.cells)
    assert (colours == colours[..., :1]).all()


def test_nav2_gets_yaml_and_image(tmp_path):
    path = tmp_path / 'floor.yaml'
    assert write_files(PICTURE, wrl=None, nav2=path) == [path, tmp_path / 'floor.pgm']
    content = yaml.safe_load(path.read_text(encoding='utf-8'))
    assert content == {
        'image': 'floor.pgm',
        'mode': 'trinary',
        'resolution': 0.01,
        'origin': [-0.015, -0.01, 0.0],
        'negate': 0,
        'occupied_thresh': 0.65,
        'free_thresh': 0.196,
    }
    assert (tmp_path / 'floor.pgm').read_bytes().startswith(b'P5\n')
    pixels = np.asarray(Image.open(tmp_path / 'floor.pgm'))
    np.testing.assert_array_equal(pixels, [[254, 0, 254], [0, 0, 254]])
    occupied = (255 - pixels.astype(float)) / 255
    np.testing.assert_array_equal(occupied > content['occupied_thresh'], PICTURE.walls)
    np.testing.assert_array_equal(occupied < content['free_thresh'], ~PICTURE.walls)


@given(st.integers(1, 20), st.integers(1, 20), st.integers(0, 2**32 - 1))
def test_each_cell_of_the_occupancy_grid_is_where_the_map_has_it(rows, columns, seed):
    values = np.array([FLOOR, WALL, LINE], dtype=np.uint8)
    floor_map = FloorMap(np.random.default_rng(seed).choice(values, (rows, columns)))
    grid = occupancy_grid(floor_map)
    assert (grid.width, grid.height) == (columns, rows)
    for row, column in np.ndindex(rows, columns):
        # The centre of the cell, in the axes of map and in plane signs.
        x = grid.origin[0] + (column + 0.5) * grid.resolution
        y = grid.origin[1] + (row + 0.5) * grid.resolution
        wall = floor_map.is_wall(floor_map.point((x, -y)))
        assert grid.cells[row, column] == (OCCUPIED if wall else FREE)
    np.testing.assert_array_equal(floor_map_of(grid).walls, floor_map.walls)


def test_existing_files_are_left_alone_and_no_export_is_partial(tmp_path):
    image = tmp_path / 'map.pgm'
    image.write_text('mine')
    with pytest.raises(WorldError, match=r'map\.pgm: already exists'):
        write_files(PICTURE, wrl=tmp_path / 'map.wrl', nav2=tmp_path / 'map.yaml')
    assert image.read_text() == 'mine'
    assert list(tmp_path.iterdir()) == [image]


def test_yaml_and_image_can_not_be_one_file(tmp_path):
    for wrl, nav2 in ((None, 'a.pgm'), ('a.pgm', 'a.yaml'), ('a.yaml', 'a.yaml')):
        with pytest.raises(WorldError, match='next to it'):
            write_files(PICTURE, wrl=wrl and tmp_path / wrl, nav2=tmp_path / nav2)
    assert list(tmp_path.iterdir()) == []


def test_a_missing_folder_is_one_line(tmp_path):
    with pytest.raises(WorldError, match='No such file or directory'):
        write_files(PICTURE, wrl=tmp_path / 'no/map.wrl', nav2=None)
