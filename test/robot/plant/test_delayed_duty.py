"""The duty that acts is the newest one whose dead time is over."""

import pytest
from hypothesis import strategies as st
from laws import given
from parts import START_NS, make_plant, nonlinear_step, physical, run_plant

from ballbot_ros.engine.plant_tick import NEVER_NS, duty_at, note_duty, waiting_count
from ballbot_ros.parameters.timing import STEP_NS, STEPS_PER_TICK, TICK_NS
from ballbot_ros.robot.plant.ground_truth import STEP_VALUES, state_before
from ballbot_ros.robot.plant.integration import (
    advance_linear,
    discrete_matrices,
    linear_rates,
    response_to_volt,
    superposed,
    zero_order_hold,
)
from ballbot_ros.robot.plant.laws import motor_voltage
from ballbot_ros.robot.plant.model import state_space

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
    count = waiting_count(delay + max(draws), False)
    effects_ns, duties, effects = [NEVER_NS] * count, [0] * (2 * count), []
    for number, drawn in enumerate(draws, 250):
        now_ns = number * TICK_NS
        if count:
            note_duty(effects_ns, duties, now_ns, (delay + drawn) * STEP_NS, number, -number)
        effects.append((number, now_ns + (delay + drawn) * STEP_NS))
        for step_ns in range(now_ns, now_ns + TICK_NS, STEP_NS):
            acting = [each for each, effect_ns in effects if effect_ns <= step_ns]
            newest = max(acting, default=0)
            if count:
                end_ns = step_ns + STEP_NS
                assert duty_at(effects_ns, duties, step_ns, end_ns) == (newest, -newest, end_ns)


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
        assert len(truth.steps) == 10 * STEP_VALUES
        for age in range(10):
            measured = state_before(truth.steps, age)
            assert_is(measured, states[max(0, number * STEPS_PER_TICK - age)])


def test_steps_that_are_kept_later_begin_with_the_present_one():
    plant = make_plant(start_pitch_x=0.02)
    assert plant.truth().steps == ()
    plant.keep_steps(2)
    run_plant(plant, DUTIES)
    known = plant.truth().steps
    plant.keep_steps(4)
    assert plant.truth().steps == (*known[:STEP_VALUES] * 2, *known)
    plant.keep_steps(1)
    assert plant.truth().steps == known[STEP_VALUES:]
    plant.keep_steps(0)
    assert plant.truth().steps == ()


def test_before_the_first_duty_takes_effect_the_motors_are_off():
    plant = make_plant(actuator_delay=100)
    *before, after = run_plant(plant, [(100, 100)] * 26)
    assert all(truth.motor_torque == (0.0, 0.0) for truth in before)
    assert after.motor_torque[0] > 0.0
    assert plant.time_ns == START_NS + 104 * STEP_NS


def parts_of_tick(effect_us):
    """Return the parts [µs] of a tick's steps, of which each has its duty: 0 before the effect."""
    for start in range(0, 4000, 1000):
        if start < effect_us < start + 1000:
            yield effect_us - start, 0
            yield start + 1000 - effect_us, 1
        else:
            yield 1000, int(effect_us <= start)


@pytest.mark.parametrize('effect_us', [0, 1, 348, 999, 1000, 1236, 2236, 3999, 4000])
@pytest.mark.parametrize('model', ['linear', 'nonlinear'])
def test_a_duty_acts_at_its_microsecond(model, effect_us):
    """A step is divided exactly where the duty changes."""
    plant = make_plant(plant_model=model, start_pitch_x=0.02, kernel=True)
    plant.tick(60, 0, 1000 * effect_us)
    state = (0.0, 0.02, 0.0, 0.0)
    for length_us, has_duty in parts_of_tick(effect_us):
        volts = voltage(60) if has_duty else 0.0
        if model == 'nonlinear':
            state = nonlinear_step(physical(), length_us * 1e-6)(state, volts, 0.0, 0.0)
        else:
            transition, held = zero_order_hold(*state_space(physical()), length_us * 1e-6)
            state = tuple(transition @ state + held @ (volts, 0.0, 0.0))
    assert plant.state.x == pytest.approx(state, rel=1e-12, abs=1e-16)


def test_duties_that_come_late_act_in_their_order():
    """The second duty leaves before the next tick, the first one after it."""
    plant = make_plant(start_pitch_x=0.0, kernel=True)
    voltages = []
    for duty, delay_ns in ((40, 5_000_000), (-40, 500_000), (10, 0)):
        plant.tick(duty, 0, delay_ns)
        voltages.append(plant.state.voltage_x)
    assert voltages == [0.0, voltage(-40), voltage(10)]


@given(
    st.tuples(*[st.floats(-10.0, 10.0)] * 4),
    st.tuples(st.floats(-9.0, 9.0), st.floats(-9.0, 9.0)),
    st.tuples(st.floats(-1.0, 1.0), st.floats(-1.0, 1.0)),
    st.integers(1, 999),
    st.sampled_from([6.69, 0.05]),
)
def test_a_response_that_is_added_is_a_change_of_the_voltage(state, volts, forces, part_us, ohms):
    p = physical(motor_resistance=ohms)
    before, after = volts
    whole = advance_linear(*discrete_matrices(p, 1e-3), state, before, *forces)
    changed = superposed(whole, response_to_volt(linear_rates(p), part_us * 1e-6), after - before)
    for length_us, voltage in ((1000 - part_us, before), (part_us, after)):
        transition, held = zero_order_hold(*state_space(p), length_us * 1e-6)
        state = transition @ state + held @ (voltage, *forces)
    scale = max(map(abs, whole)) + abs(before) + abs(after) + 1e-3
    assert changed == pytest.approx(state, rel=1e-9, abs=1e-11 * scale)
