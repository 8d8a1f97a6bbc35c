"""Dead reckoning: exact for exact sensors, and no worse than its variances say for others."""

import math
import random

import numpy as np
import pytest
from hypothesis import strategies as st
from laws import given

from ballbot_ros.engine.closed_loop import ClosedLoop
from ballbot_ros.parameters import PlantParameters
from ballbot_ros.parameters.timing import SECOND_NS, TICK_NS
from ballbot_ros.robot.brick.odometry import CALIBRATION_NS, WINDOW_NS, DeadReckoning
from ballbot_ros.run.spec import RunOptions, RunSpec

SHAPE = PlantParameters()
RADII = SHAPE.ball_radius, SHAPE.wheel_radius
QUANTITIES = ('position', 'velocity', 'pitch', 'pitch_rate')


def after(seconds, readings, offset=(600, 600), motors=(0, 0)):
    """Return the state after a calibration and the same readings [deg/s] at all ticks.

    Between the last two of them, the motors turn.
    """
    calibrated_ns = SECOND_NS + CALIBRATION_NS
    end_ns = calibrated_ns + round(seconds * SECOND_NS)
    stamps = np.arange(SECOND_NS, end_ns, TICK_NS)
    gyro = np.where(stamps[:, np.newaxis] < calibrated_ns, offset, readings)
    encoders = np.zeros((len(stamps), 2))
    encoders[-1] = motors
    odometry = DeadReckoning(*RADII)
    odometry.add(stamps, gyro, encoders)
    return odometry.state(len(stamps) - 1)


def test_a_turning_motor_moves_the_ball():
    state = after(0.5, (600, 600), motors=(360, -90))
    circumference = math.tau * SHAPE.wheel_radius
    assert state.position.value == pytest.approx((circumference, -circumference / 4))
    seconds = WINDOW_NS / SECOND_NS
    assert state.velocity.value[0] == pytest.approx(circumference / seconds)
    assert state.pitch.value.tolist() == [0.0, 0.0]


def test_a_pitching_body_moves_the_ball_under_a_motor_at_rest():
    state = after(0.5, (603, 598), offset=(601, 598))
    assert state.pitch.value == pytest.approx((math.radians(1.0), 0.0))
    assert state.pitch_rate.value == pytest.approx((math.radians(2.0), 0.0))
    assert state.position.value == pytest.approx((SHAPE.ball_radius * math.radians(1.0), 0.0))


def test_an_error_of_the_offset_does_not_add_up_for_ever():
    state = after(300.0, (601, 600))
    assert abs(state.pitch.value[0]) < 2.0 * math.sqrt(state.pitch.variance[0])
    assert abs(state.pitch_rate.value[0]) < math.radians(0.5)


def test_a_fall_is_not_taken_for_an_error():
    state = after(3.0, (620, 600))
    assert state.pitch.value[0] > math.radians(50.0)


def test_it_is_calibrated_after_a_second():
    odometry = DeadReckoning(*RADII)
    for stamp_ns, expected in (
        (5, False),
        (5 + CALIBRATION_NS - 1, False),
        (5 + CALIBRATION_NS, True),
    ):
        odometry.add(np.array([stamp_ns]), np.full((1, 2), 600), np.zeros((1, 2)))
        assert odometry.is_calibrated(np.array([0])) == [expected]


@given(st.lists(st.integers(1, 400), min_size=1, max_size=8), st.integers(0, 2**32 - 1))
def test_readings_may_come_in_parts(lengths, seed):
    numbers = np.random.default_rng(seed)
    count = sum(lengths)
    stamps = SECOND_NS + TICK_NS * np.arange(count)
    gyro = numbers.integers(590, 610, (count, 2))
    encoders = numbers.integers(-90, 90, (count, 2)).astype(float)
    together, parted = DeadReckoning(*RADII), DeadReckoning(*RADII)
    together.add(stamps, gyro, encoders)
    for end, length in zip(np.cumsum(lengths), lengths, strict=True):
        part = slice(end - length, end)
        parted.add(stamps[part], gyro[part], encoders[part])
        expected = together.state(np.arange(count)[part])
        found = parted.state(np.arange(length))
        if stamps[part][0] >= SECOND_NS + CALIBRATION_NS:
            np.testing.assert_array_equal(found, expected)
        else:  # the variances are those at the end of a part
            np.testing.assert_array_equal(found.position.value, expected.position.value)


def normalised_errors(profile, seed):
    """Return squared errors by their variances, once a second; shape (n, quantities, planes)."""
    chance = random.Random(seed)
    values = {
        'plant_sim.duration': 12.0,
        **{f'plant_sim.start_pitch_{axis}': chance.gauss(0.0, 0.03) for axis in 'xy'},
        **{f'gyro_driver.zero_rate_offset_{axis}': chance.uniform(595.0, 625.0) for axis in 'xy'},
    }
    spec = RunSpec.compose(
        'forward_backward', RunOptions(profile=profile, seed=seed, values=values)
    )
    loop, odometry = ClosedLoop(spec.parameters, spec.scenario), DeadReckoning(*RADII)
    ticks = list(loop.ticks(12.0))
    stamps = np.array([each.truth.stamp_ns for each in ticks])
    gyro = np.array([each.inputs.gyro for each in ticks])
    odometry.add(stamps, gyro, np.array([each.inputs.revolutions for each in ticks]))
    start, found = ticks[0].truth.position, []
    for row in np.flatnonzero(stamps % SECOND_NS == 0):
        if odometry.is_calibrated(row):
            truth, state = ticks[row].truth, odometry.state(row)
            way = np.subtract(truth.position, start)
            true = (way, truth.velocity, truth.psi, truth.psi_rate)
            found.append(
                [
                    np.subtract(each.value, expected) ** 2 / each.variance
                    for each, expected in zip(state, true, strict=True)
                ]
            )
    return np.array(found)


@pytest.mark.parametrize('profile', ['ideal', 'hardware'])
def test_the_errors_of_many_runs_are_covered_by_their_variances(profile):
    """Start, offsets and noise are other ones in each run.

    The mean of normalised squared errors is 1 for variances that are right, and the errors of a
    normal distribution exceed two standard deviations in 5 % of the cases.
    """
    errors = np.concatenate([normalised_errors(profile, seed) for seed in range(12)])
    for number, name in enumerate(QUANTITIES):
        mean, outside = errors[:, number].mean(), (errors[:, number] > 4.0).mean()
        assert 0.02 < mean < 1.2, (name, mean)
        assert outside < 0.08, (name, outside)
