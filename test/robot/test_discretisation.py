"""The zero-order hold, against exact rational arithmetic and another library."""

from fractions import Fraction

import numpy as np
import pytest
from scipy.linalg import expm

from ballbot_ros.robot.plant.integration import zero_order_hold


def exact(a, b, dt):
    """Return the discrete matrices by Taylor's series in rational numbers, rounded once."""
    n, m = b.shape
    block = [[Fraction(x) * Fraction(dt) for x in (*a[i], *b[i])] for i in range(n)]
    total = term = block
    for k in range(2, 60):
        product = [
            [sum(block[i][j] * term[j][column] for j in range(n)) / k for column in range(n + m)]
            for i in range(n)
        ]
        # Rounded, because the terms would grow to thousands of digits.
        term = [[Fraction(round(x * 2**400), 2**400) for x in row] for row in product]
        total = [
            [before + x for before, x in zip(*rows, strict=True)]
            for rows in zip(total, term, strict=True)
        ]
    for i in range(n):
        total[i][i] += 1
    rounded = np.array([[float(x) for x in row] for row in total])
    return rounded[:, :n], rounded[:, n:]


def random_system(seed, n=4, m=3, size=1.0):
    draw = np.random.default_rng(seed)
    return draw.normal(size=(n, n)) * size, draw.normal(size=(n, m))


@pytest.mark.parametrize('size', [1e-6, 0.1, 3.0, 10.0])
def test_every_element_is_accurate_to_a_few_units_in_the_last_place(size):
    for seed in range(8):
        a, b = random_system(seed, size=size)
        for matrix, rounded in zip(zero_order_hold(a, b, 0.5), exact(a, b, 0.5), strict=True):
            error = np.abs(matrix - rounded).max()
            assert error <= 1e-14 * np.abs(rounded).max(), seed


def test_a_motion_far_slower_than_the_step_keeps_its_digits():
    transition, held = zero_order_hold(np.array([[-1e-9]]), np.array([[1e-9]]), 1.0)
    assert held[0, 0] == pytest.approx(-np.expm1(-1e-9), rel=1e-15)
    assert transition[0, 0] == 1.0 - 1e-9


def test_a_stiff_system_settles_within_the_step():
    a = np.array([[0.0, 1.0], [0.0, -1e9]])
    transition, held = zero_order_hold(a, np.array([[0.0], [1e9]]), 1e-3)
    np.testing.assert_allclose(transition, [[1.0, 1e-9], [0.0, 0.0]], rtol=1e-6, atol=1e-20)
    np.testing.assert_allclose(held, [[1e-3], [1.0]], rtol=1e-5)


@pytest.mark.parametrize('seed', range(5))
def test_it_agrees_with_scipy(seed):
    a, b = random_system(seed, size=20.0)
    block = np.zeros((7, 7))
    block[:4, :4], block[:4, 4:] = a, b
    reference = expm(block * 0.1)[:4]
    np.testing.assert_allclose(np.hstack(zero_order_hold(a, b, 0.1)), reference, rtol=1e-9)


def test_a_system_at_rest_has_the_identity_as_transition_matrix():
    transition, held = zero_order_hold(np.zeros((2, 2)), np.zeros((2, 1)), 1.0)
    np.testing.assert_array_equal(transition, np.eye(2))
    np.testing.assert_array_equal(held, np.zeros((2, 1)))


@pytest.mark.parametrize('size', [1e200, np.inf, np.nan])
def test_an_overflow_still_terminates(size):
    with np.errstate(all='ignore'):
        zero_order_hold(np.array([[size]]), np.array([[1.0]]), 1.0)
