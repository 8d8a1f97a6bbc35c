"""The rotary encoders."""

import math

from hypothesis import strategies as st
from laws import given

from ballbot_ros.robot.brick.sensors import encoder_reading

angles = st.floats(-1e4, 1e4)


def test_the_counters_are_zero_at_the_start_pose():
    assert encoder_reading(0.0) == 0


@given(angles)
def test_counts_are_the_nearest_whole_degrees(angle):
    count = encoder_reading(angle)
    assert isinstance(count, int)
    assert abs(count - math.degrees(angle)) <= 0.5 + 1e-9
