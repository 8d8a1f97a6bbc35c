"""Steps of one plane: exactness, order, conservation."""

import control
import numpy as np
import pytest
from hypothesis import strategies as st
from laws import given
from parts import linear_step, mass_matrix_at, nonlinear_step, physical

from ballbot_ros.robot.plant.integration import advance_nonlinear, equations_of
from ballbot_ros.robot.plant.model import state_space

LOSSLESS = {'back_emf_constant': 0.0, 'motor_friction': 0.0}
STEPPERS = [linear_step, nonlinear_step]

numbers = st.floats(-1.0, 1.0)
states = st.tuples(numbers, numbers, numbers, numbers)


def run(step, state, count, voltage=0.0, force_theta=0.0, force_psi=0.0):
    path = [state]
    for _ in range(count):
        path.append(step(path[-1], voltage, force_theta, force_psi))
    return np.array(path)


def weight(p):
    return p.body_mass * p.body_height * p.gravity


def kinetic_energy(p, state, psi):
    """Return T1 + T2 of (3.5)-(3.6), with the mass matrix at a pitch."""
    return state[2:] @ mass_matrix_at(p, psi) @ state[2:] / 2.0


def energies(p, path):
    """Return T1 + T2 + U of (3.5)-(3.7) at each state, with U = 0 at the ball's centre."""
    return np.array([kinetic_energy(p, s, s[1]) + weight(p) * np.cos(s[1]) for s in path])


@pytest.mark.parametrize('dt', [1e-4, 1e-3, 4e-3, 0.1])
def test_linear_step_is_the_zero_order_hold_discretisation(dt):
    p = physical()
    a, b = state_space(p)
    discrete = control.sample_system(control.ss(a, b, np.eye(4), np.zeros((4, 3))), dt, 'zoh')
    step = linear_step(p, dt)
    columns = [step(tuple(unit), 0.0, 0.0, 0.0) for unit in np.eye(4)]
    np.testing.assert_allclose(np.transpose(columns), discrete.A, rtol=1e-9, atol=1e-12)
    columns = [step((0.0,) * 4, *unit) for unit in np.eye(3)]
    np.testing.assert_allclose(np.transpose(columns), discrete.B, rtol=1e-9, atol=1e-12)


@given(states, st.floats(-9.0, 9.0), numbers, numbers, st.sampled_from([2, 3, 10]))
def test_linear_step_is_the_same_in_parts(state, voltage, force_theta, force_psi, parts):
    p = physical()
    whole = linear_step(p, 4e-3)(state, voltage, force_theta, force_psi)
    split = run(linear_step(p, 4e-3 / parts), state, parts, voltage, force_theta, force_psi)[-1]
    np.testing.assert_allclose(split, whole, rtol=1e-10, atol=1e-11)


@given(states, states, numbers, numbers, st.tuples(numbers, numbers), st.tuples(numbers, numbers))
def test_each_plane_moves_as_if_it_were_alone(x, y, voltage_x, voltage_y, forces_x, forces_y):
    p = physical()
    together = advance_nonlinear(
        equations_of(p), p.alpha, 1e-3, x, y, voltage_x, voltage_y, *forces_x, *forces_y
    )
    alone = nonlinear_step(p, 1e-3)
    assert together == (alone(x, voltage_x, *forces_x), alone(y, voltage_y, *forces_y))


@pytest.mark.parametrize('make', STEPPERS)
@given(states, st.floats(-9.0, 9.0), numbers, numbers)
def test_the_mirrored_motion_is_the_motion_of_the_mirrored_state(
    make, state, voltage, force_theta, force_psi
):
    step = make(physical(), 1e-3)
    after = step(state, voltage, force_theta, force_psi)
    mirrored = step(tuple(-x for x in state), -voltage, -force_theta, -force_psi)
    assert tuple(-x for x in mirrored) == after


@pytest.mark.parametrize('make', STEPPERS)
@given(states, st.floats(-9.0, 9.0), st.floats(-100.0, 100.0))
def test_the_motion_does_not_depend_on_where_the_ball_is(make, state, voltage, theta):
    step = make(physical(), 1e-3)
    here = step((0.0, *state[1:]), voltage, 0.0, 0.0)
    there = step((theta, *state[1:]), voltage, 0.0, 0.0)
    assert there[1:] == here[1:]
    assert there[0] - theta == pytest.approx(here[0], abs=1e-12)


def test_the_models_diverge_with_the_cube_of_the_angle():
    p = physical()
    count = 300

    def difference(angle):
        start = (0.0, angle, 0.0, 0.0)
        linear = run(linear_step(p, 1e-3), start, count)[-1]
        return run(nonlinear_step(p, 1e-3), start, count)[-1] - linear

    np.testing.assert_allclose(difference(0.02) / difference(0.01), 8.0, rtol=0.02)


def test_runge_kutta_is_of_fourth_order():
    p = physical()
    start = (0.0, 0.3, 2.0, -1.0)

    def end(steps):
        return run(nonlinear_step(p, 0.1 / steps), start, steps, 3.0, 0.001, 0.002)[-1]

    exact = end(3200)
    errors = [np.abs(end(steps) - exact).max() for steps in (100, 200, 400)]
    orders = np.log2([errors[0] / errors[1], errors[1] / errors[2]])
    np.testing.assert_allclose(orders, 4.0, atol=0.25)


@pytest.mark.parametrize(
    'start', [(0.0, 0.01, 0.0, 0.0), (0.0, 1.0, -3.0, 2.0), (0.0, 3.0, 5.0, -4.0)]
)
def test_a_frictionless_robot_keeps_its_energy(start):
    p = physical(**LOSSLESS)
    energy = energies(p, run(nonlinear_step(p, 2e-4), start, 15000))
    np.testing.assert_allclose(energy, energy[0], rtol=1e-9)


@given(states)
def test_a_frictionless_linear_robot_keeps_its_quadratic_energy(start):
    p = physical(**LOSSLESS)
    path = run(linear_step(p, 1e-3), start, 100)
    kinetic = np.array([kinetic_energy(p, state, 0.0) for state in path])
    potential = -weight(p) * path[:, 1] ** 2 / 2.0
    scale = np.abs(kinetic).max() + np.abs(potential).max()
    np.testing.assert_allclose(kinetic + potential, kinetic[0] + potential[0], atol=1e-10 * scale)


@given(st.tuples(numbers, st.floats(-3.0, 3.0), st.floats(-20, 20), st.floats(-20, 20)))
def test_friction_never_adds_energy(start):
    p = physical(ball_friction=0.001)
    energy = energies(p, run(nonlinear_step(p, 1e-3), start, 300))
    assert np.diff(energy).max() <= 1e-12 * abs(energy[0])


@pytest.mark.parametrize('make', STEPPERS)
def test_upright_is_an_equilibrium_at_any_ball_position(make):
    state = (12.5, 0.0, 0.0, 0.0)
    assert make(physical(), 1e-3)(state, 0.0, 0.0, 0.0) == state
