"""Distance along rays: the document's steps, the exact search, and how they agree."""

import math
from functools import partial

import numpy as np
import pytest
from hypothesis import strategies as st
from laws import given
from maps import drawn, open_floor, with_walls

from ballbot_ros.robot.world.floor_map import FLOOR, WALL, FloorMap
from ballbot_ros.robot.world.sonar_beam import exact_distance, stepped_distance, wall_distance

EAST, SOUTH, WEST, NORTH = (quarter * math.pi / 2 for quarter in range(4))
FINE = 1e-3
ROUNDING = 1e-6


def exact_ray(floor_map):
    return partial(exact_distance, wall_distance(floor_map))


def stepped_ray(floor_map):
    return partial(stepped_distance, wall_distance(floor_map))


@st.composite
def scenes(draw):
    """Draw a map with random walls, a point on it and a direction."""
    generator = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    rows, columns = draw(st.tuples(st.integers(1, 60), st.integers(1, 60)))
    share = draw(st.sampled_from([0.0, 0.002, 0.02, 0.2, 0.6, 1.0]))
    walls = generator.random((rows, columns)) < share
    origin = tuple(map(float, generator.random(2) * (columns, rows)))
    direction = float(generator.random() * 2.0 * math.pi)
    return FloorMap(np.where(walls, WALL, FLOOR).astype(np.uint8)), origin, direction


def along(origin, direction, distance):
    return origin[0] + distance * math.cos(direction), origin[1] + distance * math.sin(direction)


def sampled_distance(floor_map, origin, direction):
    """Return the distance by brute force: steps of a thousandth of a cell."""
    at = np.arange(0.0, 90.0, FINE)
    u, v = (np.floor(each).astype(int) for each in along(origin, direction, at))
    inside = (u >= 0) & (u < floor_map.columns) & (v >= 0) & (v < floor_map.rows)
    hit = np.zeros(len(at), dtype=bool)
    hit[inside] = floor_map.walls[v[inside], u[inside]]
    return float(at[np.argmax(hit)]) if hit.any() else math.inf


def thickness(floor_map, origin, direction, distance):
    """Return the length of the ray within the wall that it meets at `distance`."""
    inverse = FloorMap(np.where(floor_map.walls, FLOOR, WALL).astype(np.uint8))
    return exact_ray(inverse)(along(origin, direction, distance + ROUNDING), direction)


@given(scenes())
def test_the_exact_distance_equals_brute_force(scene):
    found, expected = exact_ray(scene[0])(*scene[1:]), sampled_distance(*scene)
    assert found <= expected + ROUNDING
    # Brute force can miss a chord shorter than its step.
    if expected - found > FINE + ROUNDING:
        assert thickness(*scene, found) < FINE


@given(scenes())
def test_the_exact_distance_is_never_more_than_the_stepped_one(scene):
    assert exact_ray(scene[0])(*scene[1:]) <= stepped_ray(scene[0])(*scene[1:]) + ROUNDING


@given(scenes())
def test_they_differ_by_less_than_a_step_at_a_wall_at_least_a_step_thick(scene):
    floor_map, origin, direction = scene
    exact, stepped = (make(floor_map)(origin, direction) for make in (exact_ray, stepped_ray))
    if math.isinf(exact):
        assert math.isinf(stepped)
    elif thickness(*scene, exact) >= 1.0:
        assert stepped < exact + 1.0 + ROUNDING


@given(scenes(), st.sampled_from([EAST, SOUTH, WEST, NORTH]))
def test_along_the_axes_they_always_differ_by_less_than_a_step(scene, direction):
    floor_map, origin, _ = scene
    exact, stepped = (make(floor_map)(origin, direction) for make in (exact_ray, stepped_ray))
    if math.isinf(exact):
        assert math.isinf(stepped)
    else:
        assert exact - ROUNDING <= stepped < exact + 1.0 + ROUNDING


def test_a_step_can_jump_over_the_corner_of_a_wall():
    floor_map = with_walls(20, 20, (10, 11, 10, 11), (0, 20, 18, 19))
    origin, direction = (1.05, 0.4), math.pi / 4
    assert exact_ray(floor_map)(origin, direction) == pytest.approx(8.95 * math.sqrt(2), abs=1.0)
    missed = [
        u
        for u in np.linspace(0.0, 1.5, 301)
        if stepped_ray(floor_map)((u, 0.0), direction)
        > exact_ray(floor_map)((u, 0.0), direction) + 2.0
    ]
    assert missed


@pytest.mark.parametrize('make', [exact_ray, stepped_ray])
def test_a_ray_ends_at_the_first_wall(make):
    floor_map = drawn('.....', '...#.', '.....')
    ray = make(floor_map)
    assert ray((1.0, 1.5), EAST) == 2.0
    assert ray((3.5, 1.5), EAST) == 0.0
    assert ray((4.5, 1.5), WEST) == pytest.approx(0.5, abs=0.5)
    assert math.isinf(ray((1.0, 1.5), WEST))
    assert math.isinf(ray((1.0, 0.5), EAST))


@pytest.mark.parametrize('make', [exact_ray, stepped_ray])
@pytest.mark.parametrize('origin', [(-0.1, 1.5), (5.0, 1.5), (2.0, -1.0), (2.0, 3.0)])
def test_from_off_the_map_no_wall_is_seen(make, origin):
    ray = make(drawn('#####', '#####', '#####'))
    assert all(math.isinf(ray(origin, direction)) for direction in (EAST, SOUTH, WEST, NORTH))


@pytest.mark.parametrize('make', [exact_ray, stepped_ray])
def test_the_reach_is_255_cells(make):
    def seen(at):
        return make(with_walls(3, 400, (0, 3, at, at + 1)))((0.0, 1.5), EAST)

    assert seen(254) == 254.0
    assert math.isinf(seen(255))
    assert math.isinf(make(open_floor(3, 400))((0.0, 1.5), EAST))


def test_a_ray_does_not_pass_between_cells_that_touch_at_a_corner():
    floor_map = drawn('..#', '.#.', '#..')
    assert exact_ray(floor_map)((0.0, 0.0), math.pi / 4) <= math.sqrt(2.0) + ROUNDING
    assert math.isfinite(exact_ray(floor_map)((0.5, 0.5), math.pi / 4))
