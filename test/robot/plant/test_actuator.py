"""From duty to motor voltage."""

import pytest
from hypothesis import strategies as st
from laws import given
from parts import values_of

from ballbot_ros.parameters import PLANT
from ballbot_ros.robot.plant.laws import effective_duty, max_voltage, motor_voltage

duties = st.integers(-100, 100)
batteries = st.floats(0.0, 12.0)
dead_zones = st.floats(0.0, 50.0)


def actuator(**changes):
    """Return the function that gives the voltage for a duty and a battery voltage."""
    p = values_of(PLANT, **changes)
    return lambda duty, battery: motor_voltage(
        duty, battery, p.dead_zone, p.voltage_slope, p.voltage_offset
    )


def test_full_duty_at_8000_mv_gives_equation_6_1():
    assert actuator()(100, 8.0) == pytest.approx(0.001089 * 8000 - 0.625, rel=1e-15)


@given(duties, batteries)
def test_voltage_is_in_proportion_to_duty(duty, battery):
    motor = actuator()
    full = max_voltage(battery, 0.001089, -0.625)
    assert motor(duty, battery) == pytest.approx(duty / 100 * full, rel=1e-12)


@given(duties, batteries, dead_zones)
def test_voltage_is_odd_in_duty(duty, battery, dead_zone):
    motor = actuator(dead_zone=dead_zone)
    assert motor(-duty, battery) == -motor(duty, battery)


@given(st.integers(-100, 99), batteries, dead_zones)
def test_more_duty_never_gives_less_voltage(duty, battery, dead_zone):
    motor = actuator(dead_zone=dead_zone)
    assert motor(duty + 1, battery) >= motor(duty, battery)


@given(duties, dead_zones)
def test_the_dead_zone_is_subtracted_from_every_duty(duty, dead_zone):
    left = effective_duty(duty, dead_zone)
    assert abs(left) == pytest.approx(max(0.0, abs(duty) - dead_zone))
    assert left * duty >= 0.0


@given(st.floats(0.0, 0.57))
def test_an_empty_battery_does_not_drive_the_motor_backwards(battery):
    assert actuator()(100, battery) == 0.0
