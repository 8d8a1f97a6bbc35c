"""Each metric is the same when numba compiles it without changes."""

import math
from functools import cache

import numpy as np
import pytest
from hypothesis import strategies as st
from laws import given

from ballbot_ros.engine.compilation import compiled_and_kept
from ballbot_ros.engine.scenario.metrics import METRICS, Motion
from ballbot_ros.robot.world.clearance import NO_WALLS
from ballbot_ros.robot.world.floor_map import load_map
from ballbot_ros.robot.world.world import World

TICK = 0.004
RECORDED = ('position', 'psi', 'duty', 'timing')
DEPENDS_ON = {
    'position': {
        'position_rms_m', 'peak_position_m', 'overshoot_m', 'station_rms_m', 'station_radius_m',
        'final_position_x_m', 'final_position_y_m', 'distance_driven_m', 'peak_speed_m_per_s',
        'wall_clearance_m',
    },
    'psi': {'settling_time_s', 'peak_pitch_deg', 'steady_pitch_rms_deg'},
    'duty': {'duty_rms_percent', 'duty_saturated_share'},
    'timing': {'response_time_ms', 'lost_jobs', 'utilisation', 'duty_age_ms'},
}  # fmt: skip


@cache
def walls_of(name):
    return World(load_map(name), 0.135, 0.12).walls if name else NO_WALLS


WALLS = st.sampled_from(['', 'track', 'corridor']).map(walls_of)


@st.composite
def motions(draw):
    """Return a motion of random walks that are long or short, wide, narrow or constant."""
    count = draw(st.sampled_from([1, 2, 3]) | st.integers(1, 1000))
    generator = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))

    def walk(scales):
        steps = generator.normal(0.0, draw(st.sampled_from(scales)), (count, 2))
        return np.cumsum(steps, axis=0) + generator.normal(0.0, 0.5, 2)

    motion = Motion(
        time=draw(st.floats(0.0, 100.0)) + TICK * generator.integers(1, 3, count).cumsum(),
        position=walk([0.0, 1e-9, 0.001, 0.1]),
        psi=walk([0.0, 0.001, 0.01]) * draw(st.sampled_from([0.01, 1.0])),
        duty=np.clip(np.round(100.0 * walk([0.0, 0.01, 1.0])), -100.0, 100.0),
        start=generator.normal(0.0, 0.5, 2),
        walls=draw(WALLS),
        timing=generator.integers(-1, 3, (draw(st.sampled_from([0, count])), 4)).astype(float),
    )
    missing = draw(st.sets(st.sampled_from(RECORDED), max_size=1) | st.just(set()))
    return motion._replace(**{name: nothing_of(motion, name) for name in missing})


def nothing_of(motion, name):
    return np.full_like(getattr(motion, name), math.nan)


def assert_the_same(name, motion):
    compute = METRICS[name].compute
    # numpy adds in pairs, the compiled code one by one.
    expected = pytest.approx(compute(motion), rel=1e-9, abs=1e-13, nan_ok=True)
    # Kept on disk, as a study does: compiling takes nearly all of the time.
    assert compiled_and_kept(compute)(motion) == expected, name


@given(motions())
def test_every_metric_is_the_same_when_compiled(motion):
    """All of them of the same motions, which take longer to draw than to measure."""
    for name in METRICS:
        assert_the_same(name, motion)


@pytest.mark.parametrize('name', sorted(DEPENDS_ON['duty']))
def test_duties_may_be_bytes(name):
    compute = METRICS[name].compute

    @given(motions().filter(lambda motion: not np.isnan(motion.duty).any()))
    def check(motion):
        with_bytes = motion._replace(duty=motion.duty.astype(np.int8))
        assert compute(with_bytes) == compute(motion)
        assert_the_same(name, with_bytes)

    check()


@given(motions(), st.sampled_from(RECORDED))
def test_a_metric_is_missing_if_its_column_is(motion, column):
    motion = motion._replace(**{column: nothing_of(motion, column)})
    measured = METRICS.measure(motion)
    # A motion of one tick has no path, wherever it is.
    of_steps = {'distance_driven_m', 'peak_speed_m_per_s'} if len(motion.time) == 1 else set()
    assert all(math.isnan(measured[name]) for name in DEPENDS_ON[column] - of_steps)


def test_each_metric_depends_on_one_column():
    assert sorted(METRICS) == sorted(name for names in DEPENDS_ON.values() for name in names)
