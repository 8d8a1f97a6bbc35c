"""From a velocity to sticks, the inverse of the controller's mapping."""

import math

import pytest
from hypothesis import strategies as st
from laws import given

from ballbot_ros.errors import TeleopError
from ballbot_ros.nodes.teleop.sticks import VelocityMapping
from ballbot_ros.parameters import GamepadParameters, ParameterSet

MAPPING = VelocityMapping.from_parameters(ParameterSet().of(GamepadParameters))
FULL = MAPPING.full_speed
finite = st.floats(allow_nan=False, allow_infinity=False)


def test_a_full_stick_is_the_controllers_full_speed():
    assert pytest.approx(0.1724, abs=1e-4) == FULL


@pytest.mark.parametrize(
    ('forward', 'left', 'sticks'),
    [
        (0.0, 0.0, (0, 0)),
        (FULL, 0.0, (-100, 0)),
        (-FULL / 2, 0.0, (50, 0)),
        (0.0, FULL, (0, -100)),
        (0.0, -FULL / 4, (0, 25)),
        (2 * FULL, FULL, (-100, -50)),  # the direction stays
        (1e308, -1e308, (-100, 100)),
    ],
)
def test_velocities_become_sticks(forward, left, sticks):
    assert MAPPING.sticks(forward, left) == sticks


@given(finite, finite)
def test_no_velocity_exceeds_a_full_stick(forward, left):
    assert all(abs(value) <= 100 for value in MAPPING.sticks(forward, left))


@given(st.floats(0.5, 50.0), st.floats(-math.pi, math.pi))
def test_the_direction_stays(speed, angle):
    forward, left = speed * math.cos(angle), speed * math.sin(angle)
    vertical, horizontal = MAPPING.sticks(forward, left)
    # Two vectors have the same direction within the rounding of the sticks.
    assert abs(-vertical * left - -horizontal * forward) <= 0.5 * (abs(forward) + abs(left)) + 1e-9


@pytest.mark.parametrize('value', [math.nan, math.inf, -math.inf])
def test_velocities_that_are_not_finite_are_refused(value):
    with pytest.raises(TeleopError, match=rf'linear.x is {value:g}, not a finite number'):
        MAPPING.sticks(value, 0.0)
    with pytest.raises(TeleopError, match=rf'linear.y is {value:g}, not a finite number'):
        MAPPING.sticks(0.0, value)


def test_with_zero_speed_gain_the_sticks_stay_neutral():
    assert VelocityMapping(0.0, 0.026, 100).sticks(1.0, 1.0) == (0, 0)
