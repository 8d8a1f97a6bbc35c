"""The complete robot: start, hold, planes, falls, gears."""

import math
import pickle

import numpy as np
import pytest
from hypothesis import strategies as st
from laws import given
from parts import START_NS, linear_step, make_plant, nonlinear_step, physical, run_plant

from ballbot_ros.robot.plant.ground_truth import Push

MODELS = ['linear', 'nonlinear']
RATIO = 0.026 / 0.021
LIMIT = math.pi / 3

duty_pairs = st.lists(
    st.tuples(st.integers(-100, 100), st.integers(-100, 100)), min_size=1, max_size=60
)
pitches = st.floats(-0.5, 0.5)


def pairs(truth):
    return truth[1:8]


def numbers(truth):
    return np.array([*sum(pairs(truth), ()), truth.battery_voltage])


def test_a_tick_lasts_four_milliseconds():
    truths = run_plant(make_plant(), [(0, 0)] * 3)
    assert [truth.stamp_ns - START_NS for truth in truths] == [0, 4_000_000, 8_000_000, 12_000_000]


def test_it_starts_at_rest_in_the_start_pose():
    start = make_plant(
        start_pitch_x=0.1, start_pitch_y=-0.2, start_position_x=3.0, start_position_y=-4.0
    ).truth()
    assert start.psi == (0.1, -0.2)
    assert start.position == (3.0, -4.0)
    assert start.psi_rate == start.velocity == (0.0, 0.0)
    assert start.motor_angle == start.motor_rate == start.motor_torque == (0.0, 0.0)


@given(st.integers(0, 60), st.sampled_from(MODELS))
def test_it_is_held_still_until_the_hold_time_to_the_millisecond(hold_ms, model):
    plant = make_plant(plant_model=model, hold_time=hold_ms * 1e-3, start_pitch_x=0.05)
    for truth in run_plant(plant, [(50, 50)] * 20):
        moved = truth.psi != (0.05, 0.0) or truth.psi_rate != (0.0, 0.0)
        assert moved == (truth.stamp_ns > START_NS + hold_ms * 1_000_000)


@pytest.mark.parametrize('model', MODELS)
@given(st.integers(0, 12), st.floats(-2.0, 2.0), st.floats(-2.0, 2.0))
def test_it_is_released_with_a_rate_of_its_pitch(model, hold_ms, rate_x, rate_y):
    rates = {'start_pitch_rate_x': rate_x, 'start_pitch_rate_y': rate_y}
    plant = make_plant(plant_model=model, hold_time=hold_ms * 1e-3, **rates)
    step = (nonlinear_step if model == 'nonlinear' else linear_step)(physical(), 1e-3)
    x, y = (0.0, 0.0, 0.0, rate_x), (0.0, 0.0, 0.0, rate_y)
    for _ in range(16 - hold_ms):
        x, y = step(x, 0.0, 0.0, 0.0), step(y, 0.0, 0.0, 0.0)
    assert all(truth.psi_rate == (0.0, 0.0) for truth in run_plant(plant, [(0, 0)] * 4)
               if truth.stamp_ns <= START_NS + hold_ms * 1_000_000)  # fmt: skip
    assert (plant.state.x, plant.state.y) == (x, y)


@pytest.mark.parametrize('model', MODELS)
@given(duty_pairs, pitches, pitches)
def test_the_planes_are_alike_and_independent(model, duties, pitch_x, pitch_y):
    pitch = {'start_pitch_x': pitch_x, 'start_pitch_y': pitch_y}
    swapped = {'start_pitch_x': pitch_y, 'start_pitch_y': pitch_x}
    there = run_plant(make_plant(plant_model=model, **pitch), duties)
    back = run_plant(make_plant(plant_model=model, **swapped), [(y, x) for x, y in duties])
    for one, other in zip(there, back, strict=True):
        assert pairs(one) == tuple(pair[::-1] for pair in pairs(other))


@pytest.mark.parametrize('model', MODELS)
@given(duty_pairs, pitches, pitches)
def test_the_mirrored_robot_does_the_mirrored_motion(model, duties, pitch_x, pitch_y):
    def run(sign):
        plant = make_plant(
            plant_model=model, start_pitch_x=sign * pitch_x, start_pitch_y=sign * pitch_y
        )
        return run_plant(plant, [(sign * x, sign * y) for x, y in duties])

    for one, other in zip(run(1), run(-1), strict=True):
        np.testing.assert_array_equal(numbers(one)[:-1], -numbers(other)[:-1])


@pytest.mark.parametrize('model', MODELS)
@given(duty_pairs, pitches)
def test_the_wheel_does_not_slip_on_the_ball(model, duties, pitch):
    plant = make_plant(plant_model=model, start_pitch_x=pitch, start_position_x=7.0)
    for truth in run_plant(plant, duties):
        rolled = (truth.position[0] - 7.0) / 0.026
        assert truth.motor_angle[0] == pytest.approx(
            RATIO * (rolled - (truth.psi[0] - pitch)), abs=1e-9
        )
        assert truth.motor_rate[0] == pytest.approx(
            RATIO * (truth.velocity[0] / 0.026 - truth.psi_rate[0]), abs=1e-9
        )


def test_a_stalled_motor_has_the_torque_of_equation_3_16():
    plant = make_plant(hold_time=1.0)
    plant.tick(100, -50)
    torque = 0.317 * (0.001089 * 8000 - 0.625) / 6.69
    assert plant.truth().motor_torque == pytest.approx((torque, -torque / 2))


def test_positive_duty_rolls_the_ball_forward_and_tips_the_body_back():
    plant = make_plant()
    plant.tick(50, 0)
    truth = plant.truth()
    assert truth.velocity[0] > 0.0
    assert truth.psi_rate[0] < 0.0
    assert truth.motor_rate[0] > 0.0
    assert truth.velocity[1] == truth.psi_rate[1] == 0.0


@pytest.mark.parametrize('model', MODELS)
@pytest.mark.parametrize('plane', [0, 1])
def test_a_fallen_robot_stays_at_rest(model, plane):
    start = {f'start_pitch_{"xy"[plane]}': 0.1}
    plant = make_plant(plant_model=model, **start)
    truths = run_plant(plant, [(0, 0)] * 300)
    assert plant.fallen
    assert truths[-1].psi[plane] == LIMIT
    assert truths[-1].psi_rate == truths[-1].velocity == (0.0, 0.0)
    assert all(abs(truth.psi[plane]) <= LIMIT for truth in truths)
    # After a fall only the time changes, so nothing can overflow, however long the run.
    fixed = truths[-1]._replace(stamp_ns=0)
    for truth in run_plant(plant, [(0, 0)] * 100):
        assert truth._replace(stamp_ns=0) == fixed


@pytest.mark.parametrize('model', MODELS)
def test_a_fallen_robot_does_not_move_under_full_duty_or_pushes(model):
    plant = make_plant(plant_model=model, start_pitch_x=-1.2)
    plant.push(Push(START_NS, START_NS + 10**9, (5.0, 5.0), (1.0, 1.0)))
    _, fallen, *later = run_plant(plant, [(100, -100)] * 100)
    assert plant.fallen
    assert fallen.psi[0] == -LIMIT
    for truth in later:
        assert truth._replace(stamp_ns=fallen.stamp_ns) == fallen


@pytest.mark.parametrize('model', MODELS)
@given(duty_pairs)
def test_the_truth_is_finite_for_any_duties(model, duties):
    plant = make_plant(plant_model=model, start_pitch_y=0.02)
    for truth in run_plant(plant, duties * 10)[::10]:
        assert np.isfinite(numbers(truth)).all()


def test_an_undisturbed_robot_stands_still():
    start, *_, end = run_plant(make_plant(start_position_x=2.5), [(0, 0)] * 5000)
    assert end._replace(stamp_ns=start.stamp_ns) == start


def test_a_gear_without_play_turns_with_the_wheel_and_one_with_play_lags_by_half_of_it():
    play = 0.07
    forward = [(100, 0)] * 20
    tight = run_plant(make_plant(), forward)[-1].motor_angle[0]
    loose = run_plant(make_plant(backlash=play), forward)[-1].motor_angle[0]
    assert loose == pytest.approx(tight - play / 2, abs=1e-12)


def test_a_reversing_gear_stands_still_until_its_play_is_taken_up():
    play = 0.3
    duties = [(30, 0)] * 20 + [(-30, 0)] * 40
    truth = run_plant(make_plant(backlash=play), duties)
    wheel = [RATIO * (each.position[0] / 0.026 - each.psi[0]) for each in truth]
    shaft = [each.motor_angle[0] for each in truth]
    turn = int(np.argmax(wheel)) + 1
    rest = shaft[turn]
    inside = [abs(angle - rest) <= play / 2 for angle in wheel[turn:]]
    assert inside.count(True) > 3
    assert [angle == rest for angle in shaft[turn:]] == inside
    assert np.abs(np.subtract(shaft, wheel)).max() <= play / 2 + 1e-12
    assert shaft[-1] == pytest.approx(wheel[-1] + play / 2, abs=1e-12)


@pytest.mark.parametrize('dead_time', [{}, {'actuator_delay': 6, 'actuator_delay_jitter': 30}])
@pytest.mark.parametrize('model', MODELS)
def test_a_restored_plant_continues_identically(model, dead_time):
    def plant():
        made = make_plant(
            plant_model=model,
            battery_model='draining',
            backlash=0.07,
            start_pitch_x=0.02,
            **dead_time,
        )
        made.keep_steps(11)
        made.push(Push(START_NS, START_NS + 10**9, (0.5, -0.5)))
        return made

    duties = np.random.default_rng(1).integers(-60, 60, (60, 2)).tolist()
    first = plant()
    run_plant(first, duties[:20])
    state = pickle.loads(pickle.dumps(first.save_state()))
    expected = run_plant(first, duties[20:])
    other = plant()
    run_plant(other, duties[30:40])
    other.restore_state(state)
    assert run_plant(other, duties[20:]) == expected
