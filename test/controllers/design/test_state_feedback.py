"""State feedback: Appendix A's examples, and errors in one line."""

import numpy as np
import pytest
from hypothesis import strategies as st
from laws import given

from ballbot_ros.controllers.design.linear_model import DesignError, lqr

A = [[0.0, 1.0], [-2.0, -3.0]]
B = [[0.0], [1.0]]
UNCONTROLLABLE = [[1.0, 0.0], [0.0, 2.0]], [[1.0], [0.0]]


def test_lqr_of_appendix_a():
    np.testing.assert_allclose(lqr(A, B, np.diag([100.0, 1.0]), [[1.0]]), [[8.1980, 2.1377]], 1e-4)


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


def test_an_uncontrollable_pair_is_refused_in_one_line():
    with pytest.raises(DesignError, match=r'^[^\n]*not controllable[^\n]*no input reaches[^\n]*$'):
        lqr(*UNCONTROLLABLE, np.eye(2), [[1.0]])


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
