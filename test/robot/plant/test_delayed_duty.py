"""The duty that acts is the newest one whose dead time is over."""

from hypothesis import strategies as st
from laws import given
from parts import START_NS, make_plant, nonlinear_step, physical, run_plant

from ballbot_ros.engine.plant_tick import NEVER_NS, duty_at, note_duty, waiting_count
from ballbot_ros.parameters.timing import STEP_NS, STEPS_PER_TICK, TICK_NS
from ballbot_ros.robot.plant.laws import motor_voltage

RATIO = 0.026 / 0.021
DUTIES = [(20, 0), (-35, 5), (50, -60), (0, 80), (-90, 10)] * 4

steps = st.integers(0, 100)


def voltage(duty):
    return motor_voltage(duty, 8.0, 0.0, 0.001089, -0.625)


def states_of_plane_x(duties):
    """Return the state before the first physics step, and after each of them."""
    step, states = nonlinear_step(physical(), 1e-3), [(0.0, 0.02, 0.0, 0.0)]
    for duty in duties:
        states.append(step(states[-1], voltage(duty), 0.0, 0.0))
    return states


def assert_is(measured, state):
    theta, psi, _, psi_dot = state
    assert measured.motor_angle[0] == RATIO * (theta - (psi - 0.02))
    assert measured.psi_rate[0] == psi_dot
    assert measured.position[0] == 0.026 * theta


@given(steps, st.lists(steps, min_size=150, max_size=150))
def test_it_is_the_newest_duty_whose_dead_time_is_over(delay, draws):
    count = waiting_count(delay + max(draws))
    effects_ns, duties, effects = [NEVER_NS] * count, [0] * (2 * count), []
    for number, drawn in enumerate(draws, 250):
        now_ns = number * TICK_NS
        if count:
            note_duty(effects_ns, duties, now_ns, (delay + drawn) * STEP_NS, number, -number)
        effects.append((number, now_ns + (delay + drawn) * STEP_NS))
        for step_ns in range(now_ns, now_ns + TICK_NS, STEP_NS):
            acting = [each for each, effect_ns in effects if effect_ns <= step_ns]
            newest = max(acting, default=0)
            assert not count or duty_at(effects_ns, duties, step_ns) == (newest, -newest)


def test_a_duty_acts_from_the_physics_step_after_its_dead_time_on():
    for delay in range(1, 10):
        plant = make_plant(plant_model='nonlinear', start_pitch_x=0.02, actuator_delay=delay)
        truths = run_plant(plant, DUTIES)
        acting = [0] * delay + [duty for duty, _ in DUTIES for _ in range(STEPS_PER_TICK)]
        states = states_of_plane_x(acting)[::STEPS_PER_TICK]
        for truth, state in zip(truths, states, strict=False):
            assert_is(truth, state)


def test_a_step_in_the_past_is_the_plant_moved_to_that_instant():
    plant = make_plant(plant_model='nonlinear', start_pitch_x=0.02)
    plant.keep_steps(9)
    truths = run_plant(plant, DUTIES)
    states = states_of_plane_x([duty for duty, _ in DUTIES for _ in range(STEPS_PER_TICK)])
    for number, truth in enumerate(truths):
        assert len(truth.steps) == 10
        for age, measured in enumerate(reversed(truth.steps)):
            assert_is(measured, states[max(0, number * STEPS_PER_TICK - age)])


def test_steps_that_are_kept_later_begin_with_the_present_one():
    plant = make_plant(start_pitch_x=0.02)
    assert plant.truth().steps == ()
    plant.keep_steps(2)
    run_plant(plant, DUTIES)
    known = plant.truth().steps
    plant.keep_steps(4)
    assert plant.truth().steps == (known[0], known[0], *known)
    plant.keep_steps(1)
    assert plant.truth().steps == known[1:]
    plant.keep_steps(0)
    assert plant.truth().steps == ()


def test_before_the_first_duty_takes_effect_the_motors_are_off():
    plant = make_plant(actuator_delay=100)
    *before, after = run_plant(plant, [(100, 100)] * 26)
    assert all(truth.motor_torque == (0.0, 0.0) for truth in before)
    assert after.motor_torque[0] > 0.0
    assert plant.time_ns == START_NS + 104 * STEP_NS
