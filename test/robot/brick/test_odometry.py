"""Dead reckoning: exact for exact sensors, and no worse than its variances say for others."""

import math
import random

import numpy as np
import pytest

from ballbot_ros.engine.closed_loop import ClosedLoop
from ballbot_ros.parameters import PlantParameters
from ballbot_ros.parameters.timing import SECOND_NS, TICK_NS
from ballbot_ros.robot.brick.odometry import CALIBRATION_NS, WINDOW_NS, DeadReckoning
from ballbot_ros.run.spec import RunOptions, RunSpec

SHAPE = PlantParameters()
RADII = SHAPE.ball_radius, SHAPE.wheel_radius
QUANTITIES = ('position', 'velocity', 'pitch', 'pitch_rate')


def after(seconds, readings, offset=(600, 600)):
    """Return an odometry that was calibrated, and then had the same readings [deg/s]."""
    odometry = DeadReckoning(*RADII)
    begin = SECOND_NS
    for stamp_ns in range(begin, begin + CALIBRATION_NS, TICK_NS):
        odometry.add(stamp_ns, offset)
    begin += CALIBRATION_NS
    for stamp_ns in range(begin, begin + round(seconds * SECOND_NS), TICK_NS):
        odometry.add(stamp_ns, readings)
    return odometry


def test_a_turning_motor_moves_the_ball():
    state = after(0.5, (600, 600)).state((0, 0), (360, -90))
    circumference = math.tau * SHAPE.wheel_radius
    assert state.position.value == pytest.approx((circumference, -circumference / 4))
    seconds = WINDOW_NS / SECOND_NS
    assert state.velocity.value[0] == pytest.approx(circumference / seconds)
    assert state.pitch.value == (0.0, 0.0)


def test_a_pitching_body_moves_the_ball_under_a_motor_at_rest():
    state = after(0.5, (603, 598), offset=(601, 598)).state((0, 0), (0, 0))
    assert state.pitch.value == pytest.approx((math.radians(1.0), 0.0))
    assert state.pitch_rate.value == pytest.approx((math.radians(2.0), 0.0))
    assert state.position.value == pytest.approx((SHAPE.ball_radius * math.radians(1.0), 0.0))


def test_an_error_of_the_offset_does_not_add_up_for_ever():
    state = after(300.0, (601, 600)).state((0, 0), (0, 0))
    assert abs(state.pitch.value[0]) < 2.0 * math.sqrt(state.pitch.variance[0])
    assert abs(state.pitch_rate.value[0]) < math.radians(0.5)


def test_a_fall_is_not_taken_for_an_error():
    state = after(3.0, (620, 600)).state((0, 0), (0, 0))
    assert state.pitch.value[0] > math.radians(50.0)


def test_it_is_calibrated_after_a_second():
    odometry = DeadReckoning(*RADII)
    for stamp_ns, expected in (
        (5, False),
        (5 + CALIBRATION_NS - 1, False),
        (5 + CALIBRATION_NS, True),
    ):
        odometry.add(stamp_ns, (600, 600))
        assert odometry.is_calibrated is expected


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
    start, counts, found = None, {}, []
    for tick in loop.ticks(12.0):
        truth = tick.truth
        start = start or truth.position
        odometry.add(truth.stamp_ns, tick.inputs.gyro)
        counts[truth.stamp_ns] = tick.inputs.revolutions
        if truth.stamp_ns % SECOND_NS == 0 and odometry.is_calibrated:
            state = odometry.state(counts[odometry.then_ns], tick.inputs.revolutions)
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
