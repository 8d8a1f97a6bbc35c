"""The battery reading's steps."""

import pytest
from hypothesis import strategies as st
from laws import given

from ballbot_ros.brick.battery_monitor import battery_mv

STEP_MV = 13.85


@pytest.mark.parametrize(
    ('voltage', 'reading'), [(0.0, 0), (8.0, 8005), (9.5, 9501), (7.0, 6994), (0.0139, 14)]
)
def test_readings_of_known_voltages(voltage, reading):
    assert battery_mv(voltage) == reading


@given(st.floats(0.0, 12.0))
def test_a_reading_is_the_nearest_whole_number_of_steps(voltage):
    reading = battery_mv(voltage)
    steps = round(reading / STEP_MV)
    assert abs(reading - steps * STEP_MV) <= 0.5
    assert abs(voltage * 1000.0 - steps * STEP_MV) <= STEP_MV / 2 + 1e-9


@given(st.floats(0.0, 12.0), st.floats(0.0, 0.1))
def test_more_voltage_never_reads_less(voltage, more):
    assert battery_mv(voltage + more) >= battery_mv(voltage)


@given(st.floats(-10.0, 100.0))
def test_a_reading_fits_sixteen_bits(voltage):
    assert 0 <= battery_mv(voltage) <= 65535
