"""One step of a plane: exact discretisation for the linear model, Runge-Kutta else.

`advance_linear` and `advance_nonlinear` are functions on plain floats with a fixed order of
operations. They are several times faster than arrays of four elements, and give the same results
on every machine.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ballbot_ros.robot.arithmetic import sine_cosine
from ballbot_ros.robot.compiler_hints import inlined
from ballbot_ros.robot.plant.model import (
    PhysicalParameters,
    drive_friction,
    mass_matrix,
    state_space,
)

Matrix = NDArray[np.float64]

_TERMS = 18
"""Terms of Taylor's series: at a norm of 1/2, the next one is below 10^-21."""

_MAX_DOUBLINGS = 1100
"""Number of squarings sufficient for any finite norm."""


def zero_order_hold(a: Matrix, b: Matrix, dt: float) -> tuple[Matrix, Matrix]:
    """Return the discrete matrices of x' = A x + B u with u held for `dt` seconds.

    They are the transition (n, n) and the effect of the inputs (n, m). Scaling and squaring are
    applied to exp(M) - I with M = [[A, B], [0, 0]] dt, so that motions much slower than `dt` keep
    all their digits. The products are computed element by element in a fixed order, because those
    of numpy and the ``expm`` of scipy round differently on different processors.
    """
    n, m = b.shape
    # The upper rows of [[A, B], [0, 0]] dt; the lower ones are zero in all that follows.
    block = np.zeros((n, n + m))
    norm = 0.0
    for i in range(n):
        row = 0.0
        for j in range(n):
            block[i, j] = a[i, j] * dt
            row += abs(block[i, j])
        for j in range(m):
            block[i, n + j] = b[i, j] * dt
        norm = max(norm, row)
    doublings, scale = 0, 1.0
    while norm * scale > 0.5 and doublings < _MAX_DOUBLINGS:
        scale *= 0.5
        doublings += 1
    for i in range(n):
        for j in range(n + m):
            block[i, j] *= scale

    # X = exp(M) - I = M (I + M/2 (I + M/3 (I + ...)))
    exp_minus_one = block.copy()
    for term in range(_TERMS, 1, -1):
        exp_minus_one = _scaled_product(block, exp_minus_one, 1.0 / term, 1.0)
    # exp(2M) - I = X X + 2X
    for _ in range(doublings):
        exp_minus_one = _scaled_product(exp_minus_one, exp_minus_one, 1.0, 2.0)

    transition, held = np.zeros((n, n)), np.zeros((n, m))
    for i in range(n):
        for j in range(n):
            transition[i, j] = exp_minus_one[i, j] + (1.0 if i == j else 0.0)
        for j in range(m):
            held[i, j] = exp_minus_one[i, n + j]
    return transition, held


def _scaled_product(left: Matrix, right: Matrix, scale: float, weight: float) -> Matrix:
    """Return left · right · scale + left · weight, of matrices whose lower rows are zero."""
    n, width = left.shape
    product = np.empty((n, width))
    for i in range(n):
        for j in range(width):
            total = 0.0
            for k in range(n):
                total += left[i, k] * right[k, j]
            product[i, j] = total * scale + left[i, j] * weight
    return product


PlaneState = tuple[float, float, float, float]
"""theta, psi [rad], theta_dot, psi_dot [rad/s] of one plane."""

TransitionCoefficients = tuple[
    float, float, float, float, float, float, float, float,
    float, float, float, float, float, float, float, float,
]  # fmt: skip
"""Coefficients of psi, theta_dot, psi_dot and the voltage for each element of the next state."""

ForceCoefficients = tuple[float, float, float, float, float, float, float, float]
"""Coefficients of the forces on theta and psi for each element of the next state."""

Equations = tuple[float, float, float, float, float, float, float, float, float, float]
"""The seven numbers of the mass matrix, then Mb L g [N·m], beta and fs [N·m·s/rad].

A plain tuple, which Python unpacks several times faster than a named one.
"""


def discrete_matrices(
    p: PhysicalParameters, dt: float
) -> tuple[TransitionCoefficients, ForceCoefficients]:
    """Return the matrices of the linear model's step of `dt` seconds."""
    a, b = state_space(p)
    transition, held = zero_order_hold(a, b, dt)
    # Leave out the column of theta: as theta is a pure integral, it is that of the identity.
    return (
        (
            float(transition[0, 1]), float(transition[0, 2]), float(transition[0, 3]),
            float(held[0, 0]),
            float(transition[1, 1]), float(transition[1, 2]), float(transition[1, 3]),
            float(held[1, 0]),
            float(transition[2, 1]), float(transition[2, 2]), float(transition[2, 3]),
            float(held[2, 0]),
            float(transition[3, 1]), float(transition[3, 2]), float(transition[3, 3]),
            float(held[3, 0]),
        ),
        (
            float(held[0, 1]), float(held[0, 2]), float(held[1, 1]), float(held[1, 2]),
            float(held[2, 1]), float(held[2, 2]), float(held[3, 1]), float(held[3, 2]),
        ),
    )  # fmt: skip


LinearRates = tuple[float, float, float, float, float, float, float, float, float]
"""Coefficients of psi, theta_dot, psi_dot and the voltage, for theta_ddot and psi_ddot, and the
norm of the state's matrix.
"""

_PART_TERMS = 14
"""Terms of Taylor's series for a part of a step: at a norm of 1/2, the next one is below 10^-16."""

_MAX_PIECES = 1000


def linear_rates(p: PhysicalParameters) -> LinearRates:
    """Return the constants of the linear model (3.24)."""
    a, b = state_space(p)
    # Angles in another unit, of which the square root makes the norm smallest.
    scale = math.sqrt(max(1.0, abs(a[2, 1]), abs(a[3, 1])))
    norm = scale
    for i in range(2, 4):
        norm = max(norm, abs(a[i, 1]) / scale + abs(a[i, 2]) + abs(a[i, 3]))
    return (
        float(a[2, 1]), float(a[2, 2]), float(a[2, 3]),
        float(b[2, 0]),
        float(a[3, 1]), float(a[3, 2]), float(a[3, 3]),
        float(b[3, 0]), float(norm),
    )  # fmt: skip


def response_to_volt(rates: LinearRates, dt: float) -> PlaneState:
    """Return the state of a plane at rest after a time [s] at 1 V, exactly as the linear model."""
    pieces = pieces_of(rates[-1], dt)
    return response_of_pieces(rates, dt / pieces, pieces)


@inlined
def superposed(state: PlaneState, response: PlaneState, amount: float) -> PlaneState:
    """Return a state of the linear model with a response that is added so many times."""
    return (
        state[0] + amount * response[0],
        state[1] + amount * response[1],
        state[2] + amount * response[2],
        state[3] + amount * response[3],
    )


@inlined
def pieces_of(norm: float, dt: float) -> int:
    """Return in how many pieces a part of a step is computed."""
    return min(int(2.0 * norm * dt) + 1, _MAX_PIECES)


@inlined
def response_of_pieces(rates: LinearRates, h: float, pieces: int) -> PlaneState:
    """Return the response of :func:`response_to_volt` after so many pieces of `h` seconds."""
    a21, a22, a23, b20, a31, a32, a33, b30, _ = rates
    theta = psi = theta_dot = psi_dot = 0.0 * h
    for _ in range(pieces):
        t0, t1 = h * theta_dot, h * psi_dot
        t2 = h * (a21 * psi + a22 * theta_dot + a23 * psi_dot + b20)
        t3 = h * (a31 * psi + a32 * theta_dot + a33 * psi_dot + b30)
        theta, psi, theta_dot, psi_dot = theta + t0, psi + t1, theta_dot + t2, psi_dot + t3
        for term in range(2, _PART_TERMS + 1):
            share = h / term
            t0, t1, t2, t3 = (
                share * t2,
                share * t3,
                share * (a21 * t1 + a22 * t2 + a23 * t3),
                share * (a31 * t1 + a32 * t2 + a33 * t3),
            )
            theta, psi, theta_dot, psi_dot = theta + t0, psi + t1, theta_dot + t2, psi_dot + t3
    return theta, psi, theta_dot, psi_dot


def equations_of(p: PhysicalParameters) -> Equations:
    """Return the constants of (3.11)-(3.12)."""
    m = mass_matrix(p)
    weight = p.body_mass * p.body_height * p.gravity
    return (
        m.m11, m.m22, m.coupling, m.drive, m.det, m.det_1, m.det_2,
        weight, drive_friction(p), p.ball_friction,
    )  # fmt: skip


def advance_linear(
    transition: TransitionCoefficients,
    force_coefficients: ForceCoefficients,
    state: PlaneState,
    voltage: float,
    force_theta: float,
    force_psi: float,
) -> PlaneState:
    """Return the state of a plane one step later, by the linear model (3.24).

    Parameters
    ----------
    transition, force_coefficients : tuple of float
        Result of :func:`discrete_matrices`.
    state : tuple of float
        theta, psi [rad], theta_dot, psi_dot [rad/s].
    voltage : float
        Motor voltage [V].
    force_theta, force_psi : float
        Generalised forces [N·m].
    """
    a01, a02, a03, b00, a11, a12, a13, b10, a21, a22, a23, b20, a31, a32, a33, b30 = transition
    theta, psi, theta_dot, psi_dot = state
    if force_theta or force_psi:
        b01, b02, b11, b12, b21, b22, b31, b32 = force_coefficients
        return (
            theta + a01 * psi + a02 * theta_dot + a03 * psi_dot
            + b00 * voltage + b01 * force_theta + b02 * force_psi,
            a11 * psi + a12 * theta_dot + a13 * psi_dot
            + b10 * voltage + b11 * force_theta + b12 * force_psi,
            a21 * psi + a22 * theta_dot + a23 * psi_dot
            + b20 * voltage + b21 * force_theta + b22 * force_psi,
            a31 * psi + a32 * theta_dot + a33 * psi_dot
            + b30 * voltage + b31 * force_theta + b32 * force_psi,
        )  # fmt: skip
    return (
        theta + a01 * psi + a02 * theta_dot + a03 * psi_dot + b00 * voltage,
        a11 * psi + a12 * theta_dot + a13 * psi_dot + b10 * voltage,
        a21 * psi + a22 * theta_dot + a23 * psi_dot + b20 * voltage,
        a31 * psi + a32 * theta_dot + a33 * psi_dot + b30 * voltage,
    )


@inlined
def advance_nonlinear(
    equations: Equations,
    alpha: float,
    dt: float,
    x: PlaneState,
    y: PlaneState,
    voltage_x: float,
    voltage_y: float,
    force_theta_x: float,
    force_psi_x: float,
    force_theta_y: float,
    force_psi_y: float,
) -> tuple[PlaneState, PlaneState]:
    """Return the states of both planes `dt` seconds later, by the nonlinear model (3.11)-(3.12).

    The planes do not depend on each other. They are advanced stage by stage, so that a processor
    works on both at the same time: one after the other takes a quarter longer.

    Parameters
    ----------
    equations : tuple of float
        Result of :func:`equations_of`.
    alpha : float
        Torque of the motor per voltage [N·m/V] (3.19).
    dt : float
        Length of the step [s].
    x, y : tuple of float
        theta, psi [rad], theta_dot, psi_dot [rad/s].
    voltage_x, voltage_y : float
        Motor voltages [V].
    force_theta_x, force_psi_x, force_theta_y, force_psi_y : float
        Generalised forces [N·m].
    """
    half, sixth = dt / 2.0, dt / 6.0
    theta_x, psi_x, w1_x, r1_x = x
    theta_y, psi_y, w1_y, r1_y = y
    motor_x, motor_y = alpha * voltage_x, alpha * voltage_y
    # Not in place: they can be arrays.
    ft_x, fp_x = force_theta_x + motor_x, force_psi_x - motor_x
    ft_y, fp_y = force_theta_y + motor_y, force_psi_y - motor_y
    a1_x, c1_x = accelerations(equations, psi_x, w1_x, r1_x, ft_x, fp_x)
    a1_y, c1_y = accelerations(equations, psi_y, w1_y, r1_y, ft_y, fp_y)
    w2_x, r2_x = w1_x + half * a1_x, r1_x + half * c1_x
    w2_y, r2_y = w1_y + half * a1_y, r1_y + half * c1_y
    a2_x, c2_x = accelerations(equations, psi_x + half * r1_x, w2_x, r2_x, ft_x, fp_x)
    a2_y, c2_y = accelerations(equations, psi_y + half * r1_y, w2_y, r2_y, ft_y, fp_y)
    w3_x, r3_x = w1_x + half * a2_x, r1_x + half * c2_x
    w3_y, r3_y = w1_y + half * a2_y, r1_y + half * c2_y
    a3_x, c3_x = accelerations(equations, psi_x + half * r2_x, w3_x, r3_x, ft_x, fp_x)
    a3_y, c3_y = accelerations(equations, psi_y + half * r2_y, w3_y, r3_y, ft_y, fp_y)
    w4_x, r4_x = w1_x + dt * a3_x, r1_x + dt * c3_x
    w4_y, r4_y = w1_y + dt * a3_y, r1_y + dt * c3_y
    a4_x, c4_x = accelerations(equations, psi_x + dt * r3_x, w4_x, r4_x, ft_x, fp_x)
    a4_y, c4_y = accelerations(equations, psi_y + dt * r3_y, w4_y, r4_y, ft_y, fp_y)
    return (
        (
            theta_x + sixth * (w1_x + 2.0 * (w2_x + w3_x) + w4_x),
            psi_x + sixth * (r1_x + 2.0 * (r2_x + r3_x) + r4_x),
            w1_x + sixth * (a1_x + 2.0 * (a2_x + a3_x) + a4_x),
            r1_x + sixth * (c1_x + 2.0 * (c2_x + c3_x) + c4_x),
        ),
        (
            theta_y + sixth * (w1_y + 2.0 * (w2_y + w3_y) + w4_y),
            psi_y + sixth * (r1_y + 2.0 * (r2_y + r3_y) + r4_y),
            w1_y + sixth * (a1_y + 2.0 * (a2_y + a3_y) + a4_y),
            r1_y + sixth * (c1_y + 2.0 * (c2_y + c3_y) + c4_y),
        ),
    )


@inlined
def accelerations(
    equations: Equations,
    psi: float,
    theta_dot: float,
    psi_dot: float,
    force_theta: float,
    force_psi: float,
) -> tuple[float, float]:
    """Return theta_ddot and psi_ddot [rad/s²] of (3.11)-(3.12)."""
    m11, m22, coupling, drive, det, det_1, det_2, weight, beta, fs = equations
    sine, cosine = sine_cosine(psi)
    m12 = coupling * cosine - drive
    friction = beta * (theta_dot - psi_dot)
    total_force_theta = (
        force_theta - friction - fs * theta_dot + coupling * psi_dot * psi_dot * sine
    )
    total_force_psi = force_psi + friction + weight * sine
    determinant = det + cosine * (det_1 - det_2 * cosine)
    return (
        (m22 * total_force_theta - m12 * total_force_psi) / determinant,
        (m11 * total_force_psi - m12 * total_force_theta) / determinant,
    )
