"""The ranges of the sliders."""

import math

import pytest
from hypothesis import strategies as st
from laws import given

from ballbot_ros.viewer.tuning_sliders import Tunable


def tunable(value, low=-math.inf, high=math.inf, **kind):
    return Tunable('x', 'meaning', low, high, (value,), (value,), **kind)


@pytest.mark.parametrize(
    ('value', 'low', 'high', 'kind', 'expected'),
    [
        (1.0, 0.0, 100.0, {}, (0.0, 2.0)),
        (-0.007, -1e9, 1e9, {}, (-0.014, 0.0)),
        (-1.5, -math.inf, math.inf, {'is_array': True}, (-3.0, 0.0)),
        (0.0, -1e9, 1e9, {}, (0.0, 1.0)),
        (0.0, -1e9, 0.0, {}, (0.0, 0.0)),
        (0.5, 0.0, 0.9, {}, (0.0, 0.9)),
        (80.0, 0.0, 100.0, {}, (0.0, 100.0)),
        (30, -1, 255, {'is_whole': True}, (-1, 255)),
        (0, 0, 55, {'is_whole': True}, (0, 55)),
        (7, 0, 2**40, {'is_whole': True}, (0, 14)),
    ],
)
def test_a_slider_covers_the_bounds_or_what_is_around_the_value(value, low, high, kind, expected):
    found = tunable(value, low, high, **kind)
    assert found.range_of(value) == expected
    assert found.step_of(*expected) > 0


@given(st.floats(-1e6, 1e6), st.floats(0, 1e6), st.floats(0, 1e6), st.booleans())
def test_every_value_is_in_the_range_of_its_slider(value, below, above, is_whole):
    if is_whole:
        value, below, above = round(value), round(below), round(above)
    found = tunable(value, value - below, value + above, is_whole=is_whole)
    low, high = found.range_of(value)
    assert value - below <= low <= value <= high <= value + above
    assert 0 < found.step_of(low, high) < math.inf


def test_numbers_become_values_of_the_parameters_type():
    assert tunable(1.0).value_of((2.5,)) == 2.5
    whole = tunable(1, is_whole=True).value_of((2.0,))
    assert (whole, type(whole)) == (2, int)
    assert tunable(1.0, is_array=True).value_of((2.5, 3.0)) == [2.5, 3.0]
