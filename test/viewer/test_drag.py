"""The force of a drag."""

import math

import numpy as np
import pytest
from hypothesis import assume
from hypothesis import strategies as st
from laws import given

from ballbot_ros.viewer.live_controls import MAX_FORCE, NEWTONS_PER_METRE, drag_force

SIDE = st.floats(-2.0, 2.0)
FORCES = st.tuples(st.floats(-2.0, 2.0), st.floats(-2.0, 2.0))


def pointer_of(eye, grip, target):
    """Return the point under the pointer on the plane through the grip that faces the eye."""
    sight, normal = np.subtract(target, eye), np.subtract(grip, eye)
    return eye + sight * (normal @ normal) / (sight @ normal)


@given(SIDE, SIDE, st.floats(0.5, 3.0), FORCES)
def test_the_robot_is_pulled_to_the_pointer(x, y, height, force):
    eye, grip = np.array([x, y, height]), np.array([0.1, -0.2, 0.2])
    target = grip + np.array([force[0], -force[1], 0.0]) / NEWTONS_PER_METRE
    assume(abs((target - eye)[2]) > 0.3 * np.linalg.norm(target - eye))
    assume(np.subtract(target, eye) @ np.subtract(grip, eye) > 0.05)
    pulled = drag_force(eye, grip, pointer_of(eye, grip, target))
    assert pulled == pytest.approx(force, abs=1e-9)


def test_a_level_camera_pulls_sideways_only():
    eye, grip = (1.0, 0.0, 0.2), (0.0, 0.0, 0.2)
    forward, rightward = drag_force(eye, grip, (0.0, 0.1, 0.25))
    assert (forward, rightward) == pytest.approx((0.0, -1.0))


@given(st.tuples(*[st.floats() for _ in range(9)]))
def test_no_camera_exceeds_the_limit(numbers):
    force = drag_force(numbers[:3], numbers[3:6], numbers[6:])
    assert math.hypot(*force) <= MAX_FORCE * (1.0 + 1e-12)


def test_a_far_pointer_keeps_its_direction():
    forward, rightward = drag_force((0.0, 0.0, 2.0), (0.0, 0.0, 0.2), (3.0, 4.0, 0.2))
    assert (forward, rightward) == pytest.approx((0.6 * MAX_FORCE, -0.8 * MAX_FORCE))
