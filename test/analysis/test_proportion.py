"""Wilson's interval has the published values, and the properties of a confidence interval."""

import pytest
from hypothesis import strategies as st
from laws import given

from ballbot_ros.lab.studies.study_data import wilson_interval

PUBLISHED = {
    (81, 263): (0.2553, 0.3662),
    (15, 148): (0.0624, 0.1605),
    (0, 20): (0.0, 0.1611),
    (1, 29): (0.0061, 0.1718),
}
"""R. G. Newcombe: Two-sided confidence intervals for the single proportion. Statistics in Medicine
17 (1998), 857–872, table I, method 3."""


def test_interval_has_the_published_values():
    for counts, expected in PUBLISHED.items():
        assert wilson_interval(*counts) == pytest.approx(expected, abs=5e-5), counts


@given(st.integers(1, 10**9), st.data())
def test_interval_contains_the_share_and_mirrors_failures(count, data):
    successes = data.draw(st.integers(0, count))
    low, high = wilson_interval(successes, count)
    assert 0 <= low <= successes / count <= high <= 1
    assert low < high
    assert wilson_interval(count - successes, count) == pytest.approx((1 - high, 1 - low), abs=1e-9)


def test_nothing_tried_says_nothing():
    assert wilson_interval(0, 0) == (0, 1)
    for counts in ((2, 1), (-1, 3), (1, 0)):
        with pytest.raises(ValueError, match='of'):
            wilson_interval(*counts)
