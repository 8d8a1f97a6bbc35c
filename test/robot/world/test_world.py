"""The body on the map: frame, walls, start, clearance."""

import math

import numpy as np
import pytest
from hypothesis import strategies as st
from laws import given
from maps import drawn, open_floor, save, with_walls
from parts import values_of

from ballbot_ros.engine.compilation import compiled
from ballbot_ros.errors import WorldError
from ballbot_ros.parameters import PLANT
from ballbot_ros.robot.world.clearance import clearance
from ballbot_ros.robot.world.floor_map import load_map
from ballbot_ros.robot.world.world import World

DEPTH, WIDTH = 0.14, 0.10
NAMES = ['front left', 'front middle', 'front right', 'rear left', 'rear middle', 'rear right']


def make_world(*areas, depth=DEPTH, width=WIDTH):
    return World(with_walls(200, 200, *areas), depth, width)


def pillar(x, y):
    """Return a wall of one cell whose centre is at `x`, `y` of ``map`` [m]."""
    column, row = math.floor(100 + 100 * x), math.floor(100 - 100 * y)
    return row, row + 1, column, column + 1


def test_the_middle_of_the_image_is_the_origin_right_is_forward_and_up_is_left():
    floor_map = drawn('...', '..#', '#..')
    assert floor_map.point((0.0, 0.0)) == (1.5, 1.5)
    assert floor_map.is_wall(floor_map.point((0.01, 0.0)))
    assert floor_map.is_wall(floor_map.point((-0.01, 0.01)))
    assert not floor_map.is_wall(floor_map.point((-0.01, -0.01)))


@pytest.mark.parametrize(
    ('place', 'names'),
    [
        ((0.065, 0.045), ['front left']),
        ((0.065, -0.005), ['front middle']),
        ((0.065, -0.045), ['front right']),
        ((-0.065, 0.045), ['rear left']),
        ((-0.065, -0.005), ['rear middle']),
        ((-0.065, -0.045), ['rear right']),
        ((0.065, 0.025), ['between two points of the outline']),
        ((0.0, 0.0), ['between two points of the outline']),
    ],
)
def test_the_point_that_is_in_a_wall_is_named(place, names):
    world = make_world(pillar(*place), depth=DEPTH - 0.005, width=WIDTH - 0.005)
    assert world.blocked((0.0, 0.0))
    assert list(world.touching((0.0, 0.0))) == names


def test_a_wall_across_the_front_touches_its_three_points():
    world = make_world((0, 200, 150, 154))
    assert world.touching((0.5 - DEPTH / 2 - 1e-6, 0.0)) == ()
    assert list(world.touching((0.5 - DEPTH / 2 + 1e-6, 0.0))) == NAMES[:3]


@given(
    st.floats(-0.9, 0.9), st.floats(-0.9, 0.9), st.floats(0.0, 0.3), st.floats(0.0, 0.3),
    st.integers(0, 2**32 - 1),
)  # fmt: skip
def test_the_body_is_blocked_where_it_covers_a_wall_cell_and_only_there(x, y, depth, width, seed):
    generator = np.random.default_rng(seed)
    areas = [(r, r + 1, c, c + 1) for r, c in generator.integers(0, 200, (40, 2))]
    world = World(with_walls(200, 200, *areas), depth, width)
    left, right = 100 + 100 * x - 50 * depth, 100 + 100 * x + 50 * depth
    top, bottom = 100 + 100 * y - 50 * width, 100 + 100 * y + 50 * width
    covered = any(
        left < c + 1 and c <= right and top < r + 1 and r <= bottom for r, _, c, _ in areas
    )
    assert world.blocked((x, y)) == covered
    if not covered:
        assert world.touching((x, y)) == ()


@given(st.floats(-5.0, 5.0), st.floats(-5.0, 5.0))
def test_off_the_map_the_floor_is_free(x, y):
    world = World(drawn('##', '##'), 0.1, 0.1)
    assert world.blocked((x, y)) == (abs(x) < 0.06 and abs(y) < 0.06) or abs(x) == 0.06


def test_a_start_off_the_map_or_in_a_wall_is_refused():
    world = make_world((0, 200, 150, 154))
    world.check_start((0.0, 0.0))
    with pytest.raises(
        WorldError, match=r'x 1.5 m, y -0.2 m \(map\) is off the map, which spans x ±1 m'
    ):
        world.check_start((1.5, 0.2))
    with pytest.raises(WorldError, match=r'y 0 m \(map\) puts the body in a wall: front left, '):
        world.check_start((0.45, 0.0))


def test_the_world_is_created_from_the_parameters(tmp_path):
    assert World.of(values_of(PLANT)) is None
    path = save(with_walls(100, 100, (0, 100, 90, 100)), tmp_path / 'map.png')
    assert World.of(values_of(PLANT, map=str(path))).map.columns == 100
    with pytest.raises(WorldError, match='front middle'):
        World.of(values_of(PLANT, map=str(path), start_position_x=0.4))
    with pytest.raises(WorldError, match='unknown map'):
        World.of(values_of(PLANT, map='nowhere'))


def brute_clearance(world, position):
    """Return the distance from the body to the nearest wall cell, rectangle to rectangle [m]."""
    u, v = world.map.point(position)
    rows, columns = np.nonzero(world.map.walls)
    gap_u = np.maximum(np.abs(columns + 0.5 - u) - 0.5 - 50 * DEPTH, 0.0)
    gap_v = np.maximum(np.abs(rows + 0.5 - v) - 0.5 - 50 * WIDTH, 0.0)
    return np.hypot(gap_u, gap_v).min() / 100.0


@given(st.integers(0, 2**32 - 1))
def test_the_clearance_is_that_of_the_nearest_wall_to_a_centimetre(seed):
    generator = np.random.default_rng(seed)
    areas = [(r, r + 3, c, c + 3) for r, c in generator.integers(0, 197, (6, 2))]
    world = make_world(*areas)
    positions = generator.uniform(-0.9, 0.9, (20, 2))
    expected = [brute_clearance(world, position) for position in positions]
    np.testing.assert_allclose(clearance(world.walls, positions), expected, atol=0.0125)


def test_off_the_map_the_clearance_is_a_lower_bound():
    world = make_world((90, 110, 190, 200))
    for position in ((1.5, 0.0), (1.5, 1.5), (-2.0, 0.3), (1.02, 0.0)):
        found = clearance(world.walls, np.array([position]))[0]
        assert found <= brute_clearance(world, position) + 0.0125
    assert clearance(world.walls, np.array([(1.5, 0.0)]))[0] == pytest.approx(0.43, abs=0.0125)


def test_without_a_wall_the_clearance_is_infinite():
    world = World(open_floor(50, 50), DEPTH, WIDTH)
    np.testing.assert_array_equal(clearance(world.walls, np.zeros((3, 2))), np.full(3, np.inf))


def test_the_clearance_of_an_unknown_position_is_unknown():
    world = make_world((90, 110, 190, 200))
    found = clearance(world.walls, np.array([(math.nan, 0.0), (0.0, math.nan), (0.0, math.inf)]))
    np.testing.assert_array_equal(found, [math.nan, math.nan, math.inf])


BODY_SIZES = st.sampled_from([0.0, 0.005, 0.01, 0.135, 0.14, 0.3, 3.0])


@given(BODY_SIZES, BODY_SIZES, st.booleans(), st.integers(0, 2**32 - 1))
def test_the_clearance_is_zero_where_the_body_is_blocked(depth, width, on_edges, seed):
    generator = np.random.default_rng(seed)
    rows, columns = generator.integers(1, 200, 2)
    corners = generator.integers(0, (rows, columns), (9, 2))
    world = World(
        with_walls(rows, columns, *((r, r + 2, c, c + 2) for r, c in corners)), depth, width
    )
    positions = generator.uniform(-1.5, 1.5, (50, 2))
    if on_edges:
        positions = np.round(positions, 2)
    blocked = np.array([world.blocked(position) for position in positions.tolist()])
    found = clearance(world.walls, positions) == 0.0
    assert found[blocked].all()
    # A body that touches the edge of the map from outside is not blocked.
    assert on_edges or blocked[found].all()


def test_the_clearance_is_the_same_when_compiled():
    compiled_clearance = compiled(clearance)
    maps = [load_map('track'), load_map('corridor'), open_floor(50, 50)]
    for floor_map in maps:
        walls = World(floor_map, DEPTH, WIDTH).walls
        positions = np.random.default_rng(1).uniform(-1.5, 1.5, (1000, 2))
        positions[::100, 0] = math.nan
        np.testing.assert_array_equal(
            compiled_clearance(walls, positions), clearance(walls, positions)
        )
