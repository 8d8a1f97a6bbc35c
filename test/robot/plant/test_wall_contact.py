"""Walls: where the robot stops, the effect of the impact, and the report of a hit."""

import math
from functools import cache

import numpy as np
import pytest
from hypothesis import strategies as st
from laws import given
from maps import with_walls
from parts import START_NS, mass_matrix_at, physical, run_plant, values_of

from ballbot_ros.engine.plant import Plant
from ballbot_ros.parameters import PLANT
from ballbot_ros.robot.plant.ground_truth import Push
from ballbot_ros.robot.plant.integration import PlaneState
from ballbot_ros.robot.plant.laws import WallHit, state_after_impact
from ballbot_ros.robot.plant.model import impulse_ratio, mass_matrix
from ballbot_ros.robot.world.world import World

MODELS = ['linear', 'nonlinear']
POINT = {'body_depth': 0.0, 'body_width': 0.0}


@cache
def wall(at=0.01):
    """Return a world in which everything from a position of plane x [m] on is a wall."""
    return World(with_walls(1000, 400, (0, 1000, 200 + round(at * 100), 400)), 0.0, 0.0)


def walled_plant(floor, **changes):
    changes = {'hold_time': 0.0, 'on_wall_hit': 'report', **POINT, **changes}
    return Plant(values_of(PLANT, **changes), START_NS, floor)


def thrown(floor, force_x, force_y=0.0, seconds=0.4, **changes):
    """Return the plant and the truths of a robot after a hard push."""
    plant = walled_plant(floor, **changes)
    plant.push(Push(START_NS, START_NS + 10**8, (force_x, force_y)))
    return plant, run_plant(plant, [(0, 0)] * round(seconds * 250))


def states(limit):
    return st.tuples(
        st.floats(-10.0, 10.0), st.floats(-0.5, 0.5), st.floats(-limit, limit),
        st.floats(-limit, limit),
    )  # fmt: skip


@pytest.mark.parametrize('model', MODELS)
@given(st.floats(-1.5, 1.5))
def test_the_ratio_is_that_of_the_mass_matrix(model, psi):
    if model == 'linear':
        psi = 0.0
    m = mass_matrix_at(physical(), psi)
    ratio = impulse_ratio(mass_matrix(physical()), psi)
    assert ratio == pytest.approx(m[0, 1] / m[1, 1])


@pytest.mark.parametrize('model', MODELS)
@given(states(20.0))
def test_the_impact_is_an_impulse_at_the_balls_centre_that_stops_it(model, after):
    before: PlaneState = (after[0] - math.copysign(0.01, after[2]), 0.0, 0.0, 0.0)
    theta, psi, theta_dot, psi_dot = state_after_impact(
        before, after, mass_matrix(physical()), model == 'linear'
    )
    assert (theta, psi, theta_dot) == (before[0], after[1], 0.0)
    m = mass_matrix_at(physical(), 0.0 if model == 'linear' else after[1])
    leap = np.array([theta_dot - after[2], psi_dot - after[3]])
    impulse_on_theta, impulse_on_psi = m @ leap
    assert impulse_on_psi == pytest.approx(0.0, abs=1e-12)
    # The impulse pushes the ball back, and takes energy away.
    assert impulse_on_theta * after[2] <= 0.0
    rates, stopped = np.array(after[2:]), np.array([theta_dot, psi_dot])
    assert stopped @ m @ stopped <= rates @ m @ rates + 1e-12


@given(states(20.0))
def test_a_wall_does_not_pull(after):
    leaving = (after[0] + math.copysign(0.01, after[2]), 0.0, 0.0, 0.0)
    stopped = state_after_impact(leaving, after, mass_matrix(physical()), True)
    assert stopped == (leaving[0], *after[1:])


@pytest.mark.parametrize('model', MODELS)
@given(st.floats(0.0, 40.0), st.floats(-60.0, 60.0))
def test_along_a_wall_the_other_plane_keeps_moving(model, force_x, force_y):
    _, stopped = thrown(wall(), force_x, force_y, plant_model=model, fall_angle=1.5)
    _, free = thrown(None, 0.0, force_y, plant_model=model, fall_angle=1.5)
    for one, other in zip(stopped, free, strict=True):
        assert one.position[0] <= 0.01
        if not any(abs(psi) >= 1.5 for psi in (*one.psi, *other.psi)):
            assert one.position[1] == other.position[1]


@pytest.mark.parametrize('model', MODELS)
@given(
    st.floats(5.0, 80.0), st.floats(0.0, 2.0 * math.pi), st.integers(0, 2**32 - 1),
    st.booleans(),
)  # fmt: skip
def test_the_robot_is_never_in_or_beyond_a_wall(model, force, direction, seed, pillars):
    """Tested in a ring of one-pixel walls with one-pixel pillars in it, at any speed."""
    generator = np.random.default_rng(seed)
    ring = [(94, 95, 94, 107), (106, 107, 94, 107), (94, 107, 94, 95), (94, 107, 106, 107)]
    places = [(r, r + 1, c, c + 1) for r, c in generator.integers(95, 106, (3, 2))]
    near = [place for place in places if max(abs(place[0] - 100), abs(place[2] - 100)) > 3]
    world = World(with_walls(200, 200, *ring, *(near if pillars else ())), 0.04, 0.04)
    world.check_start((0.0, 0.0))
    plant, truths = thrown(
        world, force * math.cos(direction), force * math.sin(direction), seconds=0.6,
        plant_model=model, fall_angle=1.5, body_depth=0.04, body_width=0.04,
    )  # fmt: skip
    for truth in truths:
        assert not world.blocked(truth.position)
        assert max(map(abs, truth.position)) <= 0.04
    if force > 40.0:
        assert plant.newest_hit is not None


@pytest.mark.parametrize('model', MODELS)
def test_a_floor_without_a_wall_in_the_way_changes_nothing(model):
    duties = [(round(60 * math.sin(n / 9)), round(-50 * math.cos(n / 7))) for n in range(200)]
    free = run_plant(walled_plant(None, plant_model=model), duties)
    assert run_plant(walled_plant(wall(1.9), plant_model=model), duties) == free


def test_a_hit_begins_at_the_next_multiple_of_20_ms_and_ends_at_one_without_contact():
    plant, contacts, noticed = walled_plant(wall()), [], []
    for start, force in ((0, 60.0), (10**8, -80.0)):
        plant.push(Push(START_NS + start, START_NS + start + 2 * 10**7, (force, 0.0)))
    for _ in range(100):
        plant.tick(0, 0)
        noticed.append(plant.wall_hit)
        contacts.append(plant.newest_hit.time_ns if plant.newest_hit else 0)
    begin = next(time for time in contacts if time)
    seen = START_NS + (noticed.index(True) + 1) * 4_000_000
    assert seen % 20_000_000 == 0
    assert 0 <= seen - begin < 20_000_000
    changes = [n for n in range(1, 100) if noticed[n] != noticed[n - 1]]
    assert all((START_NS + (n + 1) * 4_000_000) % 20_000_000 == 0 for n in changes)
    assert not noticed[-1]


def test_a_hit_that_lasts_is_one_hit():
    plant = walled_plant(wall(), fall_angle=1.5)
    plant.push(Push(START_NS, START_NS + 2 * 10**8, (8.0, 0.0), (-1.0, 0.0)))
    hits = set()
    for _ in range(45):
        plant.tick(0, 0)
        if plant.wall_hit:
            hits.add(plant.newest_hit)
    assert len(hits) == 1


def test_a_hit_has_time_position_and_part():
    plant, _ = thrown(wall(), 20.0)
    hit = plant.newest_hit
    assert START_NS < hit.time_ns < START_NS + 4 * 10**8
    assert 0.0 < hit.position[0] <= 0.01
    assert 'front middle' in hit.parts


def test_a_hit_reads_as_one_line_in_the_axes_of_map():
    hit = WallHit(12_340_000_000, (0.8199, 0.1001), ('front left', 'front middle'))
    assert str(hit) == (
        'wall hit at sim time 12.340 s: ball at x 0.82 m, y -0.10 m (map), front left, front middle'
    )
    assert 'y 0.00 m' in str(hit._replace(position=(0.0, 0.0)))


@pytest.mark.parametrize('plane', [0, 1])
def test_a_hit_that_ends_the_run_switches_the_motors_off(plane):
    plant = walled_plant(wall(), on_wall_hit='stop')
    plant.push(Push(START_NS, START_NS + 10**8, (10.0, 0.0)))
    for _ in range(100):
        plant.tick(80, 80)
        assert plant.stopped == plant.wall_hit
        if plant.stopped:
            break
    truth = plant.truth()
    braking = -0.317 / 6.69 * 0.468 * truth.motor_rate[plane]
    assert truth.motor_torque[plane] == pytest.approx(braking)


def test_with_on_wall_hit_report_a_hit_does_not_end_the_run():
    plant, _ = thrown(wall(), 20.0)
    assert plant.newest_hit
    assert not plant.stopped
