"""The steps of the battery reading."""

import pytest
from hypothesis import strategies as st
from laws import given

from ballbot_ros.robot.brick.sensors import COUNT_V, battery_mv, count_of

READINGS = [(counts * 14180) >> 10 for counts in range(1024)]


@pytest.mark.parametrize(
    ('voltage', 'reading'), [(0.0, 0), (8.0, 8003), (9.5, 9499), (7.0, 7006), (0.0139, 13)]
)
def test_readings_of_known_voltages(voltage, reading):
    assert battery_mv(voltage) == reading


def test_every_count_of_the_converter_has_a_voltage_that_reads_it():
    assert [battery_mv(counts * 14.180 / 1024) for counts in range(1024)] == READINGS


@given(st.floats(0.0, 14.0))
def test_a_reading_is_the_nearest_count_truncated_to_millivolts(voltage):
    reading = battery_mv(voltage)
    assert reading in READINGS
    assert -1.0 - 14.180 / 2 * 1000 / 1024 <= reading - voltage * 1000.0 <= 7.0


@given(st.floats(0.0, 12.0), st.floats(0.0, 0.1))
def test_more_voltage_never_reads_less(voltage, more):
    assert battery_mv(voltage + more) >= battery_mv(voltage)


@given(st.floats(-10.0, 100.0))
def test_a_reading_stays_within_the_converter(voltage):
    assert 0 <= battery_mv(voltage) <= READINGS[-1]


def test_every_reading_tells_its_count():
    assert [count_of(battery_mv(counts * COUNT_V)) for counts in range(1024)] == list(range(1024))


@given(st.floats(0.0, 14.0))
def test_the_count_of_a_reading_is_the_nearest_to_the_voltage(voltage):
    assert abs(count_of(battery_mv(voltage)) * COUNT_V - voltage) <= 0.5001 * COUNT_V
