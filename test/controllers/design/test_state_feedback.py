"""State feedback: Appendix A's examples, and errors in one line."""

import numpy as np
import pytest
from hypothesis import strategies as st
from laws import given

from ballbot_ros.controllers.design.linear_model import DesignError, lqr, place

A = [[0.0, 1.0], [-2.0, -3.0]]
B = [[0.0], [1.0]]
UNCONTROLLABLE = [[1.0, 0.0], [0.0, 2.0]], [[1.0], [0.0]]


def test_pole_placement_of_appendix_a():
    np.testing.assert_allclose(place(A, B, [-5.0, -6.0]), [[28.0, 8.0]], rtol=1e-9)


def test_lqr_of_appendix_a():
    np.testing.assert_allclose(lqr(A, B, np.diag([100.0, 1.0]), [[1.0]]), [[8.1980, 2.1377]], 1e-4)


@given(st.floats(-9.0, -0.1), st.floats(0.1, 9.0))
def test_placed_poles_are_the_poles_of_the_closed_loop(real, imaginary):
    poles = [complex(real, imaginary), complex(real, -imaginary)]
    closed = np.array(A) - np.array(B) @ place(A, B, poles)
    np.testing.assert_allclose(
        np.sort_complex(np.linalg.eigvals(closed)), np.sort_complex(poles), atol=1e-6
    )


@given(st.floats(0.01, 100.0), st.floats(0.01, 100.0), st.floats(0.01, 100.0))
def test_lqr_solves_the_riccati_equation(q1, q2, r):
    gain = lqr(A, B, np.diag([q1, q2]), [[r]])
    a, b, q = np.array(A), np.array(B), np.diag([q1, q2])
    # With one input, B'P = rK gives the last row of P; the corner follows from the off-diagonal.
    p12, p22 = r * gain[0]
    p11 = gain[0, 0] * p22 * 1.0 - a[1, 1] * p12 - a[1, 0] * p22
    p = np.array([[p11, p12], [p12, p22]])
    residual = a.T @ p + p @ a - p @ b @ b.T @ p / r + q
    np.testing.assert_allclose(residual, 0.0, atol=1e-6 * (1.0 + np.abs(p).max() ** 2 / r))


@pytest.mark.parametrize('design', [lambda a, b: place(a, b, [-1.0, -2.0]),
                                    lambda a, b: lqr(a, b, np.eye(2), [[1.0]])])  # fmt: skip
def test_an_uncontrollable_pair_is_refused_in_one_line(design):
    with pytest.raises(DesignError, match=r'^[^\n]*not controllable[^\n]*no input reaches[^\n]*$'):
        design(*UNCONTROLLABLE)


@pytest.mark.parametrize('poles', [[-5.0], [-5.0, -5.0], [-5.0 + 1.0j, -6.0]])
def test_impossible_poles_are_refused_in_one_line(poles):
    with pytest.raises(DesignError, match=r'^the poles cannot be placed: [^\n]+$'):
        place(A, B, poles)


@pytest.mark.parametrize(
    ('q', 'r'),
    [
        (np.eye(3), [[1.0]]),
        (np.eye(2), [[0.0]]),
        (np.eye(2), [[-1.0]]),
        (np.eye(2), [[np.nan]]),
        (-np.eye(2), [[1.0]]),
    ],
)
def test_weights_without_a_solution_are_refused_in_one_line(q, r):
    with pytest.raises(DesignError, match=r'^no linear quadratic regulator: [^\n]+$'):
        lqr(A, B, q, r)
