"""The ultrasonic sensor."""

import math
from functools import partial

import numpy as np
import pytest
from hypothesis import strategies as st
from laws import given
from parts import values_of

from ballbot_ros.engine.devices import echo, numbers_of, sonar_constants
from ballbot_ros.parameters import SONAR

SAMPLE_NS = 20_000_000
NO_ECHO = 255


def make_sonar(**changes):
    return partial(echo, sonar_constants(numbers_of(values_of(SONAR, **changes))))


def readings(sonar, distance, count=20_000):
    return np.array([sonar(distance, n * SAMPLE_NS) for n in range(count)])


@given(st.integers(0, 254))
def test_an_ideal_sonar_reads_whole_centimetres(distance):
    assert make_sonar()(distance / 100.0, 0) == distance


@pytest.mark.parametrize(
    ('distance', 'reading'), [(0.004, 0), (0.005, 1), (1.2349, 123), (1.2351, 124), (2.54, 254)]
)
def test_it_rounds_to_the_nearest_centimetre(distance, reading):
    assert make_sonar()(distance, 0) == reading


@pytest.mark.parametrize('distance', [2.55, 10.0, math.inf])
def test_an_obstacle_out_of_range_gives_no_echo(distance):
    assert make_sonar()(distance, 0) == NO_ECHO


def test_from_the_maximum_range_on_there_is_no_echo():
    sonar = make_sonar(max_range_cm=160.0)
    assert sonar(1.59, 0) == 159
    assert sonar(1.60, 0) == NO_ECHO


def test_dropouts_have_their_share():
    share = np.mean(readings(make_sonar(dropout_probability=0.15), 1.0) == NO_ECHO)
    assert share == pytest.approx(0.15, abs=0.01)


def test_a_sonar_may_miss_every_echo_or_none():
    assert (readings(make_sonar(dropout_probability=1.0), 1.0, 1000) == NO_ECHO).all()
    assert (readings(make_sonar(dropout_probability=0.0), 1.0, 1000) == 100).all()


def test_errors_fill_their_bounds_evenly():
    errors = readings(make_sonar(noise_cm=3.0), 1.0) - 100
    assert errors.min() == -3
    assert errors.max() == 3
    assert errors.mean() == pytest.approx(0.0, abs=0.05)
    assert errors.var() == pytest.approx(3.0**2 / 3 + 1 / 12, rel=0.03)


def test_dropouts_and_errors_are_independent():
    drawn = readings(make_sonar(noise_cm=3.0, dropout_probability=0.5), 1.0)
    errors = drawn[drawn != NO_ECHO] - 100
    assert errors.min() == -3
    assert errors.max() == 3
    assert errors.mean() == pytest.approx(0.0, abs=0.1)


@given(
    st.floats(0.0, 10.0), st.floats(0.0, 50.0), st.floats(0.0, 1.0), st.integers(0, 10**6)
)  # fmt: skip
def test_a_reading_is_an_unsigned_byte(distance, noise, dropout, sample):
    sonar = make_sonar(noise_cm=noise, dropout_probability=dropout)
    reading = sonar(distance, sample * SAMPLE_NS)
    assert isinstance(reading, int)
    assert 0 <= reading <= NO_ECHO


def test_noise_depends_on_seed_and_stamp_alone():
    settings = {'noise_cm': 3.0, 'dropout_probability': 0.2}
    whole = readings(make_sonar(**settings), 1.0, 1000)
    restarted = make_sonar(**settings)
    late = [restarted(1.0, n * SAMPLE_NS) for n in (999, 500, 0)]
    assert late == [whole[999], whole[500], whole[0]]
    assert (readings(make_sonar(**settings, seed=2), 1.0, 1000) != whole).any()


def test_a_missed_echo_does_not_change_later_readings():
    settings = {'noise_cm': 3.0, 'dropout_probability': 0.2}
    far_first, near = make_sonar(**settings), make_sonar(**settings)
    far_first(math.inf, 0)
    near(1.0, 0)
    assert far_first(1.0, SAMPLE_NS) == near(1.0, SAMPLE_NS)


def test_below_the_minimum_range_half_of_the_echoes_are_missed():
    sonar = make_sonar(min_range_cm=7.0)
    assert np.mean(readings(sonar, 0.069) == NO_ECHO) == pytest.approx(0.5, abs=0.02)
    assert (readings(sonar, 0.07, 1000) == 7).all()
    worse = make_sonar(min_range_cm=7.0, dropout_probability=0.8)
    assert np.mean(readings(worse, 0.05) == NO_ECHO) == pytest.approx(0.8, abs=0.02)


def test_a_near_obstacle_is_missed_whenever_a_far_one_is():
    settings = {'noise_cm': 3.0, 'dropout_probability': 0.15}
    plain = readings(make_sonar(**settings), 0.05, 1000)
    near = readings(make_sonar(**settings, min_range_cm=7.0), 0.05, 1000)
    heard = near != NO_ECHO
    np.testing.assert_array_equal(near[heard], plain[heard])
    assert (near[plain == NO_ECHO] == NO_ECHO).all()
