"""From axes and buttons to sticks: signs, dead zone, enabling, and refused messages."""

import math

import pytest
from hypothesis import strategies as st
from laws import given

from ballbot_ros.errors import TeleopError
from ballbot_ros.nodes.teleop.sticks import JoyMapping
from ballbot_ros.parameters import GamepadParameters

BUTTONS = [0] * 21


def mapping(**changes):
    return JoyMapping.from_parameters(GamepadParameters(**changes))


def axes(left_y=0.0, right_x=0.0):
    return [0.0, left_y, right_x, 0.0, 0.0, 0.0]


def pressed(*numbers):
    return [int(number in numbers) for number in range(21)]


@pytest.mark.parametrize(
    ('left_y', 'right_x', 'sticks'),
    [
        (0.0, 0.0, (0, 0)),
        (1.0, 0.0, (-100, 0)),  # up is forward, -100
        (-1.0, 0.0, (100, 0)),
        (0.0, 1.0, (0, -100)),  # left is positive in joy
        (0.0, -1.0, (0, 100)),
        (0.525, -0.525, (-50, 50)),  # half of the range outside the dead zone
        (0.05, -0.05, (0, 0)),
        (1.0000001, -1.0000001, (-100, 100)),
    ],
)
def test_signs_and_dead_zone(left_y, right_x, sticks):
    assert mapping().sticks(axes(left_y, right_x), BUTTONS) == sticks


@given(st.floats(-1.0, 1.0), st.floats(-1.0, 1.0), st.floats(0.0, 0.95), st.integers(1, 127))
def test_sticks_never_exceed_the_full_stick(left_y, right_x, deadzone, full):
    values = mapping(deadzone=deadzone, gp_max=full).sticks(axes(left_y, right_x), BUTTONS)
    assert all(abs(value) <= full for value in values)


@given(st.floats(-1.0, 1.0), st.floats(-1.0, 1.0))
def test_more_axis_is_never_less_stick(one, other):
    low, high = sorted((one, other))
    values = [mapping().sticks(axes(value), BUTTONS)[0] for value in (low, high)]
    assert values[0] >= values[1]


def test_inverted_scaled_and_other_axes():
    other = mapping(
        axis_forward=3, axis_rightward=-1, scale_forward=0.5, invert_forward=True, deadzone=0.0
    )
    assert other.sticks([0.0, 1.0, 1.0, 1.0, 0.0, 0.0], BUTTONS) == (50, 0)


def test_the_enable_button_is_needed_where_it_is_required():
    needs = mapping(require_enable_button=True)
    assert needs.sticks(axes(1.0), pressed()) is None
    assert needs.sticks(axes(1.0), pressed(9)) == (-100, 0)


def test_the_turbo_button_enables_with_its_own_scales():
    turbo = mapping(
        require_enable_button=True, enable_turbo_button=10, scale_forward=0.4,
        scale_forward_turbo=0.8,
    )  # fmt: skip
    assert turbo.sticks(axes(1.0), pressed(9)) == (-40, 0)
    assert turbo.sticks(axes(1.0), pressed(10)) == (-80, 0)
    assert turbo.sticks(axes(1.0), pressed(9, 10)) == (-80, 0)


@pytest.mark.parametrize(
    ('given_axes', 'buttons', 'told'),
    [
        ([0.0], BUTTONS, 'axis 1 not found: the input has only 1 axes'),
        ([], BUTTONS, 'axis 1 not found: the input has only 0 axes'),
        (axes(math.nan), BUTTONS, 'axis 1 is nan, not within -1 … 1'),
        (axes(0.0, math.inf), BUTTONS, 'axis 2 is inf, not within -1 … 1'),
        (axes(-1.5), BUTTONS, 'axis 1 is -1.5, not within -1 … 1'),
        (axes(), [0, 0], 'button 9 not found: the input has only 2 buttons'),
    ],
)
def test_unusable_messages_are_refused(given_axes, buttons, told):
    with pytest.raises(TeleopError) as raised:
        mapping(require_enable_button=True).sticks(given_axes, buttons)
    assert str(raised.value) == told


def test_unused_axes_and_buttons_may_be_missing():
    assert mapping(axis_rightward=-1).sticks([0.0, 1.0], []) == (-100, 0)
