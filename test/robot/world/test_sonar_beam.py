"""The field of view of the sensor on the front face."""

import math

import pytest
from hypothesis import strategies as st
from laws import given
from maps import save, with_walls
from parts import values_of

from ballbot_ros.engine.devices import distance_ahead, numbers_of, sonar_constants
from ballbot_ros.errors import WorldError
from ballbot_ros.parameters import SONAR
from ballbot_ros.robot.world.sonar_beam import sides_of


def make_beam(**changes):
    """Return the function that gives the distance ahead of a position."""
    values = values_of(SONAR, **changes)
    constants, sides = sonar_constants(numbers_of(values)), sides_of(values)
    return lambda x, y: distance_ahead(constants, x, y, sides)


@pytest.fixture
def ahead(tmp_path):
    """A wall across the floor whose rear side is at x = 0.5 m, from y = 1 m to y = -0.2 m."""
    return str(save(with_walls(200, 200, (0, 120, 150, 154)), tmp_path / 'map.png'))


@given(st.floats(-1e3, 1e3), st.floats(-1e3, 1e3))
def test_without_a_map_there_is_no_wall(x, y):
    assert math.isinf(make_beam()(x, y))


@pytest.mark.parametrize('model', ['exact', 'stepped'])
def test_the_distance_counts_from_the_front_face(ahead, model):
    beam = make_beam(map=ahead, distance_model=model)
    assert beam(0.0, 0.0) == pytest.approx(0.4325, abs=0.01)
    assert make_beam(map=ahead, body_depth=0.0)(0.1, 0.0) == pytest.approx(0.4)


def test_rightward_is_towards_the_bottom_of_the_image(ahead):
    beam = make_beam(map=ahead)
    assert math.isfinite(beam(0.0, 0.19))
    assert math.isinf(beam(0.0, 0.21))


def test_a_sensor_reads_zero_in_a_wall_and_no_echo_off_the_map(ahead):
    beam = make_beam(map=ahead)
    assert beam(0.45, 0.0) == 0.0
    assert math.isinf(beam(0.95, 0.0))


def test_a_cone_sees_walls_next_to_the_middle_ray(ahead):
    position = (0.1325, 0.25)  # 30 cm in front of the wall, 5 cm next to its end
    assert math.isinf(make_beam(map=ahead)(*position))
    cone = make_beam(map=ahead, cone_angle=0.52)
    assert cone(*position) == pytest.approx(0.30 / math.cos(0.26), abs=0.02)
    assert math.isinf(make_beam(map=ahead, cone_angle=0.1)(*position))


@given(st.floats(-0.9, 0.4), st.floats(-0.9, 0.9), st.floats(0.01, 1.5))
def test_a_cone_never_sees_less_than_its_middle_ray(x, y, angle):
    single = make_beam(map='track')
    for rays in (1, 3, 7):
        cone = make_beam(map='track', cone_angle=angle, cone_rays=rays)
        assert cone(x, y) <= single(x, y)
        if rays == 1:
            assert cone(x, y) == single(x, y)


def test_an_even_number_of_rays_is_refused():
    with pytest.raises(WorldError, match='cone_rays: 6 is even'):
        make_beam(cone_rays=6)
