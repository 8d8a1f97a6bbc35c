"""The shipped maps, and finding them."""

import numpy as np
import pytest
from maps import drawn, save

from ballbot_ros.errors import WorldError
from ballbot_ros.robot.world.floor_map import LINE, load_map, map_names


def test_the_shipped_maps_are_found_by_name():
    assert map_names() == ['corridor', 'track']
    assert load_map('track').cells.shape == (200, 200)
    assert load_map('corridor').cells.shape == (100, 300)


@pytest.mark.parametrize('name', map_names())
def test_a_shipped_map_is_closed_by_walls(name):
    walls = load_map(name).walls
    for edge in (walls[0], walls[-1], walls[:, 0], walls[:, -1]):
        assert edge.all()
    assert not walls.all()


def test_the_track_has_black_lines():
    assert np.count_nonzero(load_map('track').cells == LINE) > 500


def test_an_unknown_name_lists_the_shipped_ones():
    with pytest.raises(WorldError, match="'nosuch'; shipped: corridor, track"):
        load_map('nosuch')


@pytest.mark.parametrize('name', ['map.png', 'map.bmp', 'MAP.PNG', './map'])
def test_a_name_with_an_image_suffix_or_a_slash_is_a_file(tmp_path, monkeypatch, name):
    monkeypatch.chdir(tmp_path)
    floor_map = drawn('.#', '-.')
    save(floor_map, tmp_path / 'any.png').rename(tmp_path / name)
    np.testing.assert_array_equal(load_map(name).cells, floor_map.cells)
