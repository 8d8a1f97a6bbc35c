"""The gyros: offset, range, noise, drift."""

import math

import numpy as np
import pytest
from hypothesis import strategies as st
from laws import given
from parts import values_of

from ballbot_ros.engine.devices import GYRO_DEVICE, gyro_constants
from ballbot_ros.parameters import GYRO
from ballbot_ros.robot.brick.sensors import gyro_offset

TICK_NS = 4_000_000
STILL = (0.0, 0.0)


def make_gyro(**changes):
    return GYRO_DEVICE.make(values_of(GYRO, **changes))


def readings(gyro, count, rates=STILL, start=0):
    return np.array([gyro(rates, (start + n) * TICK_NS) for n in range(count)])


def test_at_rest_it_reads_the_zero_rate_offset():
    assert make_gyro()(STILL, 0) == (600, 600)
    assert make_gyro(zero_rate_offset_x=595.0, zero_rate_offset_y=625.0)(STILL, 0) == (
        595,
        625,
    )


@given(st.integers(-360, 360), st.integers(-360, 360))
def test_each_gyro_reads_the_rate_of_its_plane_in_degrees(x, y):
    rates = (math.radians(x), math.radians(y))
    assert make_gyro()(rates, 0) == (600 + x, 600 + y)


@given(st.floats(-1e6, 1e6))
def test_the_rate_saturates_at_the_range(rate):
    reading, _ = make_gyro()((rate, 0.0), 0)
    assert 600 - 360 <= reading <= 600 + 360
    if abs(rate) > math.radians(360.0):
        assert abs(reading - 600) == 360


@given(st.floats(-1e6, 1e6), st.floats(0.0, 1023.0), st.floats(0.0, 100.0), st.integers(0, 10**6))
def test_a_reading_is_a_ten_bit_number(rate, offset, noise, tick):
    gyro = make_gyro(zero_rate_offset_x=offset, noise=noise, rate_limit=1e4)
    reading, _ = gyro((rate, rate), tick * TICK_NS)
    assert isinstance(reading, int)
    assert 0 <= reading <= 1023


def test_the_converter_clips_what_the_range_would_allow():
    gyro = make_gyro(zero_rate_offset_x=1000.0, zero_rate_offset_y=20.0)
    assert gyro((math.radians(100), math.radians(-100)), 0) == (1023, 0)


def test_noise_has_its_standard_deviation_and_no_bias():
    drawn = readings(make_gyro(noise=0.7), 20_000)
    np.testing.assert_allclose(drawn.mean(axis=0), 600.0, atol=0.02)
    # Rounding to whole counts adds a variance of a twelfth.
    np.testing.assert_allclose(drawn.var(axis=0), 0.7**2 + 1 / 12, rtol=0.03)
    assert abs(np.corrcoef(drawn, rowvar=False)[0, 1]) < 0.03


def test_noise_depends_on_seed_and_stamp_alone():
    whole = readings(make_gyro(noise=0.7), 1000)
    np.testing.assert_array_equal(readings(make_gyro(noise=0.7), 300, start=700), whole[700:])
    backwards = make_gyro(noise=0.7)
    again = [backwards(STILL, n * TICK_NS) for n in reversed(range(1000))]
    np.testing.assert_array_equal(again[::-1], whole)
    assert (readings(make_gyro(noise=0.7, seed=2), 1000) != whole).any()


def test_an_ideal_gyro_has_no_noise_whatever_the_seed():
    for seed in (0, 1, 2**63 - 1):
        assert (readings(make_gyro(seed=seed), 500) == 600).all()


def test_drift_is_slow_and_within_its_amplitude():
    gyro = make_gyro(drift=5.0, drift_period=100.0)
    drawn = readings(gyro, 25_000) - 600
    assert drawn.min(axis=0).tolist() == [-5, -5]
    assert drawn.max(axis=0).tolist() == [5, 5]
    assert np.abs(np.diff(drawn, axis=0)).max() == 1
    np.testing.assert_allclose(drawn.mean(axis=0), 0.0, atol=0.01)


@pytest.mark.parametrize('seed', [1, 2, 3])
def test_drift_repeats_after_its_period(seed):
    gyro = make_gyro(drift=5.0, drift_period=100.0, seed=seed)
    one, next_one = (readings(gyro, 1000, start=start) for start in (0, 25_000))
    assert np.abs(one - next_one).max() <= 1
    assert np.mean(one != next_one) < 0.01


def test_each_gyro_and_seed_has_a_different_drift_phase():
    first = {make_gyro(drift=50.0, seed=seed)(STILL, 0) for seed in range(20)}
    assert len(first) > 15
    assert any(x != y for x, y in first)


@given(st.floats(500.0, 700.0), st.floats(0.0, 50.0), st.floats(1.0, 1000.0), st.integers(0, 10**6))
def test_the_true_offsets_are_the_readings_at_rest_before_rounding(offset, drift, period, tick):
    changes = {'zero_rate_offset_x': offset, 'drift': drift, 'drift_period': period}
    at_rest = make_gyro(**changes)(STILL, tick * TICK_NS)
    constants = gyro_constants(values_of(GYRO, **changes))
    offsets = [gyro_offset(each, tick * TICK_NS) for each in (constants.x, constants.y)]
    assert at_rest == tuple(math.floor(each + 0.5) for each in offsets)
