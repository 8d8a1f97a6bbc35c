"""Conversions that are exact both ways, and the one way to round."""

import math

import numpy as np
import pytest
from hypothesis import example
from hypothesis import strategies as st
from laws import given

from ballbot_ros.robot.brick.sensors import (
    NO_DATA_CM,
    NO_ECHO_CM,
    battery_mv,
    degrees_to_radians,
    metres_to_sonar_cm,
    quantise,
    radians_to_degrees,
    sonar_cm_to_metres,
)

INT32 = st.integers(-(2**31), 2**31 - 1)


@pytest.mark.parametrize(
    ('value', 'rounded'),
    [(0.5, 1), (-0.5, 0), (1.5, 2), (-1.5, -1), (2.5, 3), (-2.5, -2), (0.4, 0), (-0.6, -1)],
)
def test_halves_round_up_on_either_side_of_zero(value, rounded):
    assert quantise(value) == rounded


@given(st.floats(-1e9, 1e9))
def test_the_rounding_error_is_at_most_half(value):
    assert value - 0.5 <= quantise(value) <= value + 0.5


@given(st.integers(-(2**40), 2**40))
def test_whole_numbers_round_to_themselves(value):
    assert quantise(float(value)) == value


@given(INT32)
@example(-(2**31))
@example(2**31 - 1)
def test_every_angle_in_degrees_comes_back_from_radians(degrees):
    assert radians_to_degrees(degrees_to_radians(degrees)) == degrees


def test_every_gyro_reading_and_every_encoder_angle_of_a_run_comes_back():
    for degrees in range(-100_000, 100_000):
        assert radians_to_degrees(degrees_to_radians(degrees)) == degrees


def test_a_turn_is_two_pi():
    assert degrees_to_radians(360) == pytest.approx(2.0 * math.pi, rel=1e-15)


@pytest.mark.parametrize('precision', [np.float32, np.float64])
def test_every_sonar_reading_comes_back_through_a_message(precision):
    for reading in range(-1, 256):
        assert metres_to_sonar_cm(float(precision(sonar_cm_to_metres(reading)))) == reading


def test_missing_distances_follow_rep_117():
    assert sonar_cm_to_metres(NO_ECHO_CM) == math.inf
    assert math.isnan(sonar_cm_to_metres(NO_DATA_CM))
    assert sonar_cm_to_metres(254) == 2.54


@given(st.floats(0.0, 12.0, width=32))
def test_the_battery_reads_the_same_through_a_message(voltage):
    assert battery_mv(float(np.float32(voltage))) == battery_mv(voltage)
