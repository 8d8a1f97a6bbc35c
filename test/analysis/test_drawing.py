"""Elements of figures, which look the same in all of them."""

import numpy as np
import pytest
from matplotlib.figure import Figure

from ballbot_ros.analysis import comparison
from ballbot_ros.analysis.drawing import (
    STATE_COLOURS,
    draw_floor,
    draw_row,
    draw_track,
    legend_above,
)
from ballbot_ros.analysis.figure_parts import BLUE, ON_DARK, Line
from ballbot_ros.analysis.panels import TRUE_PITCH
from ballbot_ros.robot.world.floor_map import load_map, occupancy_grid


@pytest.fixture
def axes():
    return Figure().subplots()


def drawn_floor(axes):
    (image,) = axes.get_images()
    return image.get_array(), image.get_extent()


def test_a_map_and_its_grid_show_the_same_walls_in_the_same_place(axes):
    floor_map = load_map('track')
    draw_floor(axes, floor_map)
    shades, extent = drawn_floor(axes)
    other = Figure().subplots()
    draw_floor(other, occupancy_grid(floor_map))
    walls, of_grid = drawn_floor(other)
    assert of_grid == pytest.approx(extent)
    assert walls.count() == floor_map.walls.sum()
    assert (walls.compressed() == shades[floor_map.walls]).all()
    assert not walls.mask[floor_map.walls].any()


def test_the_lines_of_a_map_are_drawn_lighter_than_its_walls(axes):
    floor_map = load_map('track')
    draw_floor(axes, floor_map)
    shades, _ = drawn_floor(axes)
    wall, line = np.unique(shades.compressed())
    assert wall < line < 1.0
    assert (shades[floor_map.walls] == wall).all()


def test_the_ends_of_a_single_track_are_named_in_the_legend_those_of_several_have_its_colour(axes):
    table = {'map_x_cm': np.array([0.0, 9.0]), 'map_y_cm': np.array([0.0, 5.0])}
    draw_track(axes, table, Line(BLUE))
    draw_track(axes, table, Line('#009E73', label='B other'))
    legend_above(axes)
    names = [text.get_text() for text in axes.get_legend().get_texts()]
    assert names == ['start', 'end', 'B other']
    _, start, end, line, *ends = axes.get_lines()
    assert start.get_color() != end.get_color()
    assert {each.get_color() for each in ends} == {line.get_color()}
    for first, last in ((start, end), ends):
        assert (first.get_marker(), last.get_marker()) == ('o', 's')
        assert first.get_xydata().tolist() == [[0.0, 0.0]]
        assert last.get_xydata().tolist() == [[9.0, 5.0]]


def test_plane_x_is_named_first_and_drawn_over_plane_y(axes):
    rows = np.zeros(3)
    draw_row(axes, TRUE_PITCH.row({'time_s': rows, 'pitch_x_deg': rows, 'pitch_y_deg': rows}))
    x, y = axes.get_lines()
    assert (x.get_label(), y.get_label()) == ('plane x', 'plane y')
    assert x.get_zorder() > y.get_zorder()


def test_states_and_curves_have_different_colours_on_a_dark_page_too():
    for colours in (STATE_COLOURS.values(), comparison._COLOURS):
        assert len({ON_DARK.get(each, each) for each in colours}) == len(set(colours))
