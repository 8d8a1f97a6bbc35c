"""Distributions of what varies: bounds, order, shape."""

import hypothesis.strategies as st
import numpy as np
import pytest
from laws import given
from scipy import stats

from ballbot_ros.lab.studies.variables import Levels, LogUniform, Normal, Uniform, whole_numbers

SHARES = np.array([0.0, 1e-300, 1e-17, 1e-9, 0.25, 0.5, 0.75, 1.0 - 1e-9, 1.0 - 2.0**-53])


@st.composite
def continuous(draw, ends):
    low, high = sorted(draw(st.lists(ends, min_size=2, max_size=2, unique=True)))
    kind = draw(st.sampled_from(('uniform', 'log_uniform', 'normal')))
    if kind == 'uniform':
        return Uniform(low, high)
    if kind == 'log_uniform':
        positive = sorted(
            draw(st.lists(st.integers(1, 10**9), min_size=2, max_size=2, unique=True))
        )
        return LogUniform(*positive)
    mean = low + draw(st.floats(0.0, 1.0)) * (high - low)
    return Normal(low, high, min(mean, high), draw(st.floats(1e-9, 1e9)))


@given(continuous(st.floats(-1e9, 1e9)))
def test_values_are_within_the_ends_and_rise_with_the_share(distribution):
    low, high = distribution.ends
    values = distribution.values(SHARES)
    assert np.isfinite(values).all()
    assert low <= values.min() <= values.max() <= high
    span = high - low
    assert (np.diff(values) >= -1e-12 * max(abs(low), abs(high), span)).all()


@given(continuous(st.integers(-(10**6), 10**6)))
def test_whole_numbers_are_within_the_ends(distribution):
    whole = whole_numbers(distribution)
    values = whole.values(SHARES)
    assert values.dtype == np.int64
    low, high = whole.ends
    assert low <= values.min() <= values.max() <= high


def test_both_ends_of_whole_numbers_are_as_likely_as_the_others():
    for low, high in ((0, 8), (-3, 2), (5, 6)):
        count = high - low + 1
        values = whole_numbers(Uniform(low, high)).values(
            (np.arange(count * 100) + 0.5) / count / 100
        )
        assert np.bincount(values - low).tolist() == [100] * count, (low, high)


def test_the_largest_whole_numbers_do_not_overflow():
    values = whole_numbers(Uniform(0, 2**63 - 1)).values(SHARES)
    assert values.min() == 0
    assert values.max() > 9e18


@pytest.mark.parametrize(
    ('distribution', 'law'),
    [
        (Uniform(2.0, 5.0), stats.uniform(2.0, 3.0)),
        (LogUniform(1e-4, 1e-2), stats.loguniform(1e-4, 1e-2)),
        (Normal(0.0, 1.5, 0.7, 0.2), stats.truncnorm(-3.5, 4.0, 0.7, 0.2)),
        (Normal(0.9, 30.0, 1.0, 2.0), stats.truncnorm(-0.05, 14.5, 1.0, 2.0)),
    ],
)
def test_the_quantiles_are_those_of_the_law(distribution, law):
    shares = np.linspace(0.001, 0.999, 500)
    np.testing.assert_allclose(distribution.values(shares), law.ppf(shares), rtol=1e-9)


def test_levels_have_equal_chances():
    levels = Levels(('linear', 'nonlinear', 'other'))
    values = levels.values((np.arange(300) + 0.5) / 300)
    assert np.unique(values, return_counts=True)[1].tolist() == [100, 100, 100]
    assert levels.values(SHARES)[-1] == 'other'
