"""Sine, cosine and logarithm: their laws, and the exact values."""

import math
import random
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import strategies as st
from laws import given

from ballbot_ros.robot import arithmetic as e
from ballbot_ros.robot.arithmetic import TWO_PI, natural_log, sine_cosine, sines_cosines

angles = st.floats(-50.0, 50.0)
far_angles = st.floats(allow_nan=False, allow_infinity=False)


def ulps(value, exact):
    return abs(value - exact) / math.ulp(exact)


@pytest.mark.parametrize('limit', [1e-3, math.pi / 4, 1.5, 10.0, 1e3, 1e6])
def test_sine_and_cosine_are_accurate_to_about_a_unit_in_the_last_place(limit):
    draw = random.Random(1)
    worst = 0.0
    for _ in range(20_000):
        angle = draw.uniform(-limit, limit)
        sine, cosine = sine_cosine(angle)
        worst = max(worst, ulps(sine, math.sin(angle)), ulps(cosine, math.cos(angle)))
    assert worst <= 2.0


@given(angles | far_angles)
def test_sine_is_odd_and_cosine_even(angle):
    sine, cosine = sine_cosine(angle)
    assert sine_cosine(-angle) == (-sine, cosine)


def test_the_symmetry_holds_where_the_reduction_changes_its_quarter():
    for n in range(-99, 100, 2):
        middle = n * math.pi / 4
        for angle in (math.nextafter(middle, -math.inf), middle, math.nextafter(middle, math.inf)):
            sine, cosine = sine_cosine(angle)
            assert sine_cosine(-angle) == (-sine, cosine)


@given(st.lists(angles | far_angles | st.floats(-0.8, 0.8), max_size=5))
def test_those_of_a_column_have_the_same_bits(column):
    expected = np.array([sine_cosine(angle) for angle in column]).reshape(-1, 2).T
    assert sines_cosines(np.array(column, float)).tobytes() == expected.copy().tobytes()


def test_a_column_may_have_angles_that_are_not_finite():
    sines, cosines = sines_cosines(np.array([[math.inf, 4.0], [math.nan, -0.0]]))
    assert (sines[1, 1], cosines[1, 1]) == sine_cosine(0.0)
    assert (sines[0, 1], cosines[0, 1]) == sine_cosine(4.0)
    assert np.isnan([sines[:, 0], cosines[:, 0]]).all()


@given(angles)
def test_they_lie_on_the_unit_circle(angle):
    sine, cosine = sine_cosine(angle)
    assert sine * sine + cosine * cosine == pytest.approx(1.0, abs=4e-16)


@given(angles, st.floats(-1.0, 1.0))
def test_the_sum_of_angles(one, other):
    (s1, c1), (s2, c2) = sine_cosine(one), sine_cosine(other)
    sine, cosine = sine_cosine(one + other)
    assert sine == pytest.approx(s1 * c2 + c1 * s2, abs=1e-14)
    assert cosine == pytest.approx(c1 * c2 - s1 * s2, abs=1e-14)


def test_quarters_of_a_turn():
    expected = [(0, 1), (1, 0), (0, -1), (-1, 0)]
    for quarters in range(-9, 10):
        assert sine_cosine(quarters * math.pi / 2) == pytest.approx(
            expected[quarters % 4], abs=1e-14
        )


@pytest.mark.parametrize('angle', [2.0**20, 1e9, 1e300, -1e300])
def test_a_huge_angle_still_lies_on_the_unit_circle(angle):
    sine, cosine = sine_cosine(angle)
    assert sine * sine + cosine * cosine == pytest.approx(1.0)


@given(st.floats(2.0**20, allow_infinity=False) | st.floats(2.0**20, 2.0**40))
def test_a_huge_angle_is_first_reduced_by_whole_turns(angle):
    assert sine_cosine(angle) == sine_cosine(math.fmod(angle, TWO_PI))


@pytest.mark.parametrize('angle', [math.inf, -math.inf, math.nan])
def test_an_infinite_angle_gives_nan(angle):
    assert np.isnan(sine_cosine(angle)).all()


def test_near_zero_the_sine_is_the_angle():
    assert sine_cosine(0.0) == (0.0, 1.0)
    assert sine_cosine(1e-300) == (1e-300, 1.0)


def test_the_logarithm_is_accurate_to_about_a_unit_in_the_last_place():
    draw = random.Random(2)
    numbers = [draw.uniform(0.0, 1.0) for _ in range(20_000)]
    numbers += [10.0 ** draw.uniform(-300.0, 300.0) for _ in range(20_000)]
    numbers += [1.0 + draw.uniform(-1e-6, 1e-6) for _ in range(1000)]
    assert max(ulps(natural_log(x), math.log(x)) for x in numbers) <= 2.0
    assert natural_log(1.0) == 0.0


@given(st.floats(1e-100, 1e100), st.floats(1e-100, 1e100))
def test_the_logarithm_of_a_product(one, other):
    assert natural_log(one * other) == pytest.approx(
        natural_log(one) + natural_log(other), rel=1e-14, abs=1e-13
    )


def sine_by_angle(z):
    """Return 1 - z/6 + z^2/120 ... of a rational number, far more accurate than any rounding."""
    term = total = Fraction(1)
    for n in range(2, 42, 2):
        term *= -z / (n * (n + 1))
        total += term
    return total


def test_the_polynomial_equals_the_sine_to_less_than_a_quarter_of_the_last_place():
    """Computed in exact arithmetic, so that only the coefficients matter."""
    coefficients = [Fraction(c) for c in (e._S3, e._S5, e._S7, e._S9, e._S11, e._S13)]
    for n in range(1, 201):
        z = Fraction(n, 200) * Fraction(math.pi / 4) ** 2
        polynomial = 1 + sum(c * z ** (k + 1) for k, c in enumerate(coefficients))
        assert abs(polynomial - sine_by_angle(z)) < Fraction(1, 2**55)


def test_the_parts_of_pi_and_of_the_logarithm_of_two_are_exact():
    """Compare the sums of the parts with the constants to 40 digits."""
    half_pi = Fraction('1.5707963267948966192313216916397514420985')
    ln_2 = Fraction('0.6931471805599453094172321214581765680755')
    parts = Fraction(e._HALF_PI_1) + Fraction(e._HALF_PI_2) + Fraction(e._HALF_PI_3)
    assert abs(parts - half_pi) < Fraction(1, 10**36)
    assert abs(Fraction(e._LN2_1) + Fraction(e._LN2_2) - ln_2) < Fraction(1, 10**25)
