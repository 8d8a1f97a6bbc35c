"""The rotary encoders."""

import math

from hypothesis import strategies as st
from laws import given

from ballbot_ros.brick.encoder import Encoder

angles = st.floats(-1e4, 1e4)


def test_the_counters_are_zero_at_the_start_pose():
    assert Encoder().read((0.0, 0.0), 0) == (0, 0)


@given(angles, angles)
def test_counts_are_the_nearest_whole_degrees_of_each_motor(x, y):
    for count, angle in zip(Encoder().read((x, y), 0), (x, y), strict=True):
        assert isinstance(count, int)
        assert abs(count - math.degrees(angle)) <= 0.5 + 1e-9


@given(st.lists(angles, min_size=2, max_size=5))
def test_a_reading_does_not_depend_on_those_before(path):
    encoder = Encoder()
    for angle in path:
        assert encoder.read((angle, -angle), 0) == Encoder().read((angle, -angle), 4_000_000)
