"""The equations of motion against the document's figures and against the Lagrangian."""

import cmath
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import strategies as st
from laws import given
from parts import mass_matrix_at, nonlinear_step, physical

from ballbot_ros.robot.plant.model import state_space

# From the table of section 3.1 in exact fractions.
ALPHA = 0.04738415545590433
BETA = 0.030179543027973522
MASS_MATRIX = [
    [0.0004965718185941043, 0.0029935468480725624],
    [0.0029935468480725624, 0.02630062648526077],
]
A = [
    [0.0, 0.0, 1.0, 0.0],
    [0.0, 0.0, 0.0, 1.0],
    [0.0, -830.670435659408, -215.6921292591607, 215.6921292591607],
    [0.0, 137.79224105122495, 25.69764021037891, -25.69764021037891],
]
B = [0.0, 0.0, 338.65288728718554, -40.34723048820979]
OPEN_LOOP_POLES = [-241.82, -5.675, 0.0, 6.102]

angles = st.floats(-4.0, 4.0)
rates = st.floats(-20.0, 20.0)
states = st.tuples(angles, angles, rates, rates)


def test_motor_constants_are_those_of_equation_3_19():
    p = physical()
    assert p.alpha == pytest.approx(ALPHA, rel=1e-14)
    assert p.beta == pytest.approx(BETA, rel=1e-14)


def test_mass_matrix_is_that_of_the_linear_equations():
    np.testing.assert_allclose(mass_matrix_at(physical(), 0.0), MASS_MATRIX, rtol=1e-13)


def test_state_space_is_that_of_the_table():
    a, b = state_space(physical())
    np.testing.assert_allclose(a, A, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(b[:, 0], B, rtol=1e-12)


def test_open_loop_poles_are_the_documents():
    a, _ = state_space(physical())
    poles = np.linalg.eigvals(a)
    assert not np.iscomplex(poles).any()
    np.testing.assert_allclose(sorted(poles.real), OPEN_LOOP_POLES, rtol=1e-4, atol=1e-12)


def test_the_linear_equations_are_the_tangent_of_the_nonlinear_ones():
    p = physical(ball_friction=0.002)
    a, b = state_space(p)
    step = 1e-6

    def slope(state, voltage=0.0, force_theta=0.0, force_psi=0.0):
        inputs = (voltage, force_theta, force_psi)
        after = nonlinear_step(p, step)(tuple(state), *inputs)
        before = nonlinear_step(p, -step)(tuple(state), *inputs)
        return (np.array(after) - np.array(before)) / (2.0 * step)

    nudge = 1e-4
    for column, unit in enumerate(np.eye(4)):
        np.testing.assert_allclose(slope(nudge * unit) / nudge, a[:, column], rtol=1e-6, atol=1e-4)
    for column, unit in enumerate(np.eye(3)):
        np.testing.assert_allclose(slope(np.zeros(4), *unit), b[:, column], rtol=1e-6, atol=1e-6)


def lagrangian(p, q, q_dot):
    """T1 + T2 - U of (3.1)-(3.8); accepts complex coordinates, for its derivatives."""
    theta_dot, psi_dot = q_dot
    psi = q[1]
    Rs, L = p.ball_radius, p.body_height
    Js = 2.0 * p.ball_mass * Rs**2 / 3.0
    Jpsi = p.body_mass * L**2 / 3.0
    Jw = p.wheel_mass * p.wheel_width**2 / 2.0
    motor_rate = Rs / p.wheel_radius * (theta_dot - psi_dot)
    ball = SimpleNamespace(x_dot=Rs * theta_dot, z=Rs)
    body = SimpleNamespace(
        x_dot=Rs * theta_dot + L * psi_dot * cmath.cos(psi),
        z_dot=-L * psi_dot * cmath.sin(psi),
        z=Rs + L * cmath.cos(psi),
    )
    translation = p.ball_mass * ball.x_dot**2 + p.body_mass * (body.x_dot**2 + body.z_dot**2)
    rotation = (
        Js * theta_dot**2 + Jpsi * psi_dot**2 + p.motor_inertia * motor_rate**2 + Jw * motor_rate**2
    )
    potential = p.gravity * (p.ball_mass * ball.z + p.body_mass * body.z)
    return translation / 2.0 + rotation / 2.0 - potential


def gradient(function, at):
    """Complex-step differentiation: exact to the last digits, without a finite difference."""
    tiny = 1e-30
    return np.array(
        [
            function([x + tiny * 1j * (i == j) for j, x in enumerate(at)]).imag / tiny
            for i in range(len(at))
        ]
    )


@given(states, st.floats(-9.0, 9.0), st.floats(-0.1, 0.1), st.floats(-0.1, 0.1))
def test_lagranges_equations_hold_along_the_motion(state, voltage, force_theta, force_psi):
    p = physical(ball_friction=0.002)
    dt = 1e-6

    def momenta(at):
        return gradient(lambda q_dot: lagrangian(p, at[:2], q_dot), at[2:])

    inputs = (voltage, force_theta, force_psi)
    after = nonlinear_step(p, dt)(state, *inputs)
    before = nonlinear_step(p, -dt)(state, *inputs)
    inertial = (momenta(after) - momenta(before)) / (2.0 * dt)
    potential = gradient(lambda q: lagrangian(p, q, state[2:]), state[:2])

    _, _, theta_dot, psi_dot = state
    motor = ALPHA * voltage - BETA * (theta_dot - psi_dot)
    forces = np.array([motor - 0.002 * theta_dot + force_theta, -motor + force_psi])
    np.testing.assert_allclose(inertial - potential, forces, atol=1e-6)
