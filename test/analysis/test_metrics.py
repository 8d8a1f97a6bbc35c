"""Metrics of trajectories whose answers are known."""

import math

import numpy as np
import pytest
from hypothesis import strategies as st
from laws import given
from maps import open_floor, with_walls
from parts import values_of

from ballbot_ros.analysis.metrics import judge, measure, measure_one, measured_window
from ballbot_ros.engine.compilation import compiled
from ballbot_ros.engine.scenario.metrics import METRICS, OF_TASKS
from ballbot_ros.engine.scenario.scenario import Expectation, Measure
from ballbot_ros.engine.trajectory import Trajectory
from ballbot_ros.parameters import PLANT
from ballbot_ros.robot.world.clearance import NO_WALLS
from ballbot_ros.robot.world.world import World

TICK = 0.004


def trajectory(pitch_deg=(0.0,), position=(0.0,), duty=(0,), pitch_y_deg=None, position_y=None):
    """Return a trajectory of plane x, and of plane y if given; short lists are padded."""
    columns = [pitch_deg, pitch_y_deg or [0.0], position, position_y or [0.0], duty]
    count = max(map(len, columns))
    padded = [[*column, *[column[-1]] * (count - len(column))] for column in columns]
    psi_x, psi_y, x, y, duties = map(np.array, padded)
    return Trajectory(
        time=np.arange(count) * TICK,
        position=np.column_stack([x, y]).astype(float),
        psi=np.radians(np.column_stack([psi_x, psi_y])),
        duty=np.column_stack([duties, duties]).astype(np.int8),
    )


def metrics(run, *, walls=NO_WALLS, start=0.0, end=math.inf, **plant):
    values = values_of(PLANT, **{'hold_time': 0.0, **plant})
    if (start, end) == (0.0, math.inf):
        return measure(run, values, walls)
    return {name: measure_one(Measure(name, start, end), run, values, walls) for name in METRICS}


def test_a_robot_at_rest_has_nothing_to_measure():
    measured = metrics(trajectory([0.0] * 100))
    assert list(measured) == list(METRICS)
    assert all(math.isnan(measured.pop(name)) for name in ('wall_clearance_m', *OF_TASKS))
    assert set(measured.values()) == {0.0}


def test_it_settles_at_the_last_time_that_a_pitch_leaves_the_band():
    pitch = [4.0] * 25 + [0.5] * 25 + [-1.5] * 25 + [0.9] * 25
    assert metrics(trajectory(pitch))['settling_time_s'] == pytest.approx(75 * TICK)


def test_either_plane_can_unsettle_it():
    run = trajectory([4.0] * 10 + [0.0] * 90, pitch_y_deg=[0.0] * 50 + [-2.0] + [0.0] * 49)
    assert metrics(run)['settling_time_s'] == pytest.approx(51 * TICK)


def test_the_band_belongs_to_the_settled_robot():
    assert metrics(trajectory([0.999999] * 10))['settling_time_s'] == 0.0
    assert metrics(trajectory([1.000001] + [0.0] * 10))['settling_time_s'] == pytest.approx(TICK)


def test_a_robot_that_never_settles_has_no_settling_time():
    assert math.isnan(metrics(trajectory([0.0] * 99 + [2.0]))['settling_time_s'])


def test_the_peak_pitch_is_that_of_either_plane_and_sign():
    run = trajectory([4.0, -6.0, 1.0], pitch_y_deg=[0.0, 5.0, -5.5])
    assert metrics(run)['peak_pitch_deg'] == pytest.approx(6.0)


def test_steady_pitch_is_that_of_the_second_half():
    run = trajectory([9.0] * 50 + [3.0, -3.0] * 25 + [3.0])
    assert metrics(run)['steady_pitch_rms_deg'] == pytest.approx(3.0 / math.sqrt(2.0))


def test_distances_are_from_the_start_in_both_planes():
    run = trajectory(position=[2.0, 5.0], position_y=[-1.0, 3.0])
    measured = metrics(run, start_position_x=2.0, start_position_y=-1.0)
    assert measured['peak_position_m'] == pytest.approx(5.0)
    assert measured['position_rms_m'] == pytest.approx(5.0 / math.sqrt(2.0))
    assert measured['final_position_x_m'] == pytest.approx(3.0)
    assert measured['final_position_y_m'] == pytest.approx(4.0)


def test_duties_count_in_both_motors():
    measured = metrics(trajectory(duty=[100, -100, 60, 0]))
    assert measured['duty_rms_percent'] == pytest.approx(math.sqrt((2 * 100**2 + 60**2) / 4))
    assert measured['duty_saturated_share'] == pytest.approx(0.5)


def test_a_sine_has_its_known_mean_square():
    time = np.arange(1001) * TICK
    sine = list(2.0 * np.sin(2.0 * math.pi * time / 0.4))
    measured = metrics(trajectory(sine, pitch_y_deg=sine))
    assert measured['steady_pitch_rms_deg'] == pytest.approx(2.0 / math.sqrt(2.0), rel=1e-2)
    assert measured['peak_pitch_deg'] == pytest.approx(2.0, rel=1e-4)


def test_nothing_before_the_release_counts():
    held = {'pitch_deg': [9.0] * 50, 'position': [9.0] * 50, 'duty': [100] * 50}
    free = {'pitch_deg': [2.0] * 10 + [0.0] * 40, 'position': [0.1] * 50, 'duty': [10] * 50}
    both = {name: held[name] + free[name] for name in held}
    after = metrics(trajectory(**both), hold_time=50 * TICK)
    assert after == pytest.approx(metrics(trajectory(**free)), nan_ok=True)
    assert after['settling_time_s'] == pytest.approx(10 * TICK)


def test_the_tick_of_the_release_counts():
    run = trajectory([9.0] * 10 + [7.0] + [0.0] * 10)
    assert metrics(run, hold_time=10 * TICK)['peak_pitch_deg'] == pytest.approx(7.0)


@pytest.mark.parametrize('count', [0, 5])
def test_a_run_that_ended_before_the_release_has_no_metrics(count):
    run = trajectory([1.0] * 5)
    run = Trajectory(*(column[:count] for column in vars(run).values()))
    measured = metrics(run, hold_time=1.0)
    assert list(measured) == list(METRICS)
    assert all(math.isnan(value) for value in measured.values())


def test_a_run_of_one_tick_can_be_measured():
    measured = metrics(trajectory([0.5], position=[0.25], duty=[-20]))
    assert measured['settling_time_s'] == 0.0
    assert measured['steady_pitch_rms_deg'] == pytest.approx(0.5 / math.sqrt(2.0))
    assert measured['peak_position_m'] == 0.25
    assert measured['duty_rms_percent'] == 20.0


def test_the_overshoot_is_beyond_the_final_position_from_the_farthest_point():
    there = [(0.0, 0.0), (0.6, 0.8), (0.72, 0.96), (0.6, 0.8)]
    for sign, way, overshoot in ((1.0, there, 0.2), (-1.0, there, 0.2), (-1.0, there[:2], 0.0)):
        x, y = np.transpose(way) * sign
        found = metrics(trajectory(position=x.tolist(), position_y=y.tolist()))['overshoot_m']
        assert found == pytest.approx(overshoot), (sign, way)
        assert math.copysign(1.0, found) == 1.0, (sign, way)


def test_the_path_length_counts_motion_in_both_directions():
    measured = metrics(trajectory(position=[0.0, 0.3, 0.0], position_y=[0.0, 0.4, 0.0]))
    assert measured['distance_driven_m'] == pytest.approx(1.0)
    assert measured['peak_speed_m_per_s'] == pytest.approx(0.5 / TICK)


def test_the_clearance_is_the_minimum_along_the_path():
    wall = World(with_walls(200, 200, (0, 200, 190, 200)), 0.1, 0.1).walls
    run = trajectory(position=[*np.linspace(0.0, 0.5, 51), *np.linspace(0.5, 0.2, 50)])
    measured = metrics(run, walls=wall)
    assert measured['wall_clearance_m'] == pytest.approx(0.9 - 0.5 - 0.05, abs=0.0125)
    open_walls = World(open_floor(200, 200), 0.1, 0.1).walls
    assert math.isnan(metrics(run, walls=open_walls)['wall_clearance_m'])


def test_a_window_counts_its_own_ticks_and_both_ends():
    run = trajectory([1.0] * 10 + [2.0] * 10 + [3.0] * 10, position=[float(n) for n in range(30)])
    window = metrics(run, start=10 * TICK, end=19 * TICK)
    assert window['peak_pitch_deg'] == pytest.approx(2.0)
    assert window['final_position_x_m'] == 19.0
    assert window['distance_driven_m'] == pytest.approx(9.0)
    assert metrics(run, start=10 * TICK)['peak_pitch_deg'] == pytest.approx(3.0)


def test_the_window_is_the_same_when_compiled():
    compiled_window = compiled(measured_window)

    @given(
        st.integers(0, 50), st.floats(0.0, 0.3), st.floats(0.0, 0.3),
        st.floats(0.0, 0.3) | st.just(math.inf), st.integers(0, 2**32 - 1),
    )  # fmt: skip
    def check(count, hold_time, start, end, seed):
        # Some ticks are missing, as in a damaged recording.
        ticks = np.random.default_rng(seed).integers(1, 3, count).cumsum()
        arguments = ticks * TICK, hold_time, start, end
        first, last = measured_window(*arguments)
        assert (first, last) == compiled_window(*arguments)
        inside = (ticks * TICK > max(hold_time, start) - TICK / 2) & (ticks * TICK < end + TICK / 2)
        assert np.flatnonzero(inside).tolist() == list(range(first, last))

    check()


def test_a_window_before_the_release_or_after_the_end_has_no_metrics():
    run = trajectory([1.0] * 10)
    for window in ({'start': 1.0}, {'end': 0.5, 'hold_time': 0.6}):
        assert all(math.isnan(value) for value in metrics(run, **window).values())


def test_an_expectation_is_judged_by_its_metric_in_its_window():
    run = trajectory([5.0] * 10 + [1.0] * 10)
    whole = Expectation('peak_pitch_deg', maximum=4.0)
    late = Expectation('peak_pitch_deg', maximum=4.0, start=10 * TICK)
    never = Expectation('peak_pitch_deg', maximum=4.0, start=1.0)
    judged = judge([whole, late, never], run, values_of(PLANT, hold_time=0.0))
    assert [each.expectation for each in judged] == [whole, late, never]
    assert [each.holds for each in judged] == [False, True, False]
    assert judged[1].value == pytest.approx(1.0)


@given(
    st.lists(
        st.tuples(st.floats(-60, 60), st.floats(-5, 5), st.integers(-100, 100)),
        min_size=1,
        max_size=30,
    )
)
def test_the_mirrored_run_has_the_same_metrics(rows):
    pitch, position, duty = (list(column) for column in zip(*rows, strict=True))
    one = metrics(trajectory(pitch, position, duty))
    other = metrics(trajectory(*([-x for x in column] for column in (pitch, position, duty))))
    other['final_position_x_m'] *= -1.0
    assert other == pytest.approx(one, nan_ok=True)
