"""The difference between the duties of two controllers."""

import pytest

from ballbot_ros.analysis.message_comparison import Divergence


def test_equal_duties_do_not_diverge():
    divergence = Divergence()
    divergence.add(4, (1, 2), (1, 2))
    assert (divergence.ticks, divergence.differing, divergence.first_ns) == (1, 0, None)
    assert divergence.rms == (0.0, 0.0)


def test_differences_are_counted_by_plane():
    divergence = Divergence()
    divergence.add(4, (0, 0), (0, 0))
    divergence.add(8, (3, 0), (0, -8))
    divergence.add(12, (-100, 0), (-96, 0))
    divergence.add(16, (0, 0), (0, 0))
    assert (divergence.ticks, divergence.differing, divergence.first_ns) == (4, 2, 8)
    assert divergence.largest == (4, 8)
    assert divergence.rms == pytest.approx((2.5, 4.0))
