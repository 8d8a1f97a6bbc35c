"""The mean of rounded readings, against averages over many of them."""

import numpy as np
import pytest
from hypothesis import strategies as st
from laws import given
from scipy.stats import norm

from ballbot_ros.analysis.identification.experiment import (
    ROUNDING_DEVIATION,
    common_rounding,
    expected_rounding,
)

ERRORS = norm.ppf((np.arange(100_000) + 0.5) / 100_000)
"""Normal errors, equally likely."""

VALUES = np.linspace(-1.5, 2.5, 81)


@pytest.mark.parametrize('noise', [0.3, 0.7])
def test_the_expected_rounding_is_the_average_over_the_noise(noise):
    average = [np.mean(np.floor(x + noise * ERRORS + 0.5)) - x for x in VALUES]
    np.testing.assert_allclose(expected_rounding(VALUES, noise), average, atol=1e-4)


@pytest.mark.parametrize('noise', [0.0, 0.3, 0.7])
def test_the_expected_rounding_is_odd_and_repeats_with_every_count(noise):
    rounding = expected_rounding(VALUES, noise)
    np.testing.assert_allclose(expected_rounding(-VALUES, noise), -rounding, atol=1e-12)
    np.testing.assert_allclose(expected_rounding(VALUES + 3.0, noise), rounding, atol=1e-12)


def test_noise_takes_the_rounding_out_of_the_mean():
    sizes = [np.abs(expected_rounding(VALUES, noise)).max() for noise in (0.1, 0.3, 0.5, 0.7)]
    assert sizes == sorted(sizes, reverse=True)
    assert sizes[0] > 0.2
    assert sizes[-1] < 1e-4


@given(st.floats(0.0, 3.0), st.floats(0.0, 1.0))
def test_values_that_are_spread_have_less_rounding_in_common(spread, more):
    assert 0.0 < common_rounding(spread + more) <= common_rounding(spread) <= ROUNDING_DEVIATION


def test_less_noise_than_a_tenth_leaves_no_sharp_edges():
    least = expected_rounding(VALUES, 0.1)
    for noise in (0.0, 0.05):
        np.testing.assert_array_equal(expected_rounding(VALUES, noise), least)
