"""The battery pack."""

import numpy as np
import pytest
from hypothesis import strategies as st
from laws import given
from parts import make_plant, run_plant, values_of

from ballbot_ros.parameters import PLANT
from ballbot_ros.robot.plant.laws import capacity_slope, discharge

DRAINING = {'battery_model': 'draining'}


class Battery:
    """A battery that drains."""

    def __init__(self, **changes):
        self.p = values_of(PLANT, **changes)
        self.charge, self.voltage = 0.0, self.p.battery_voltage

    def draw(self, current, seconds):
        p = self.p
        self.charge, self.voltage = discharge(
            self.charge, current, seconds, p.idle_current, p.battery_voltage,
            capacity_slope(p.battery_capacity), p.battery_resistance,
        )  # fmt: skip


def test_a_constant_battery_ignores_the_load():
    truths = run_plant(make_plant(hold_time=10.0), [(100, -100)] * 500)
    assert {truth.battery_voltage for truth in truths} == {8.0}


@given(st.lists(st.floats(0.0, 3.0), min_size=1, max_size=20))
def test_drawn_charge_never_returns(currents):
    battery = Battery()
    idle = []
    for current in currents:
        battery.draw(current, 1.0)
        battery.draw(0.0, 1e-6)
        idle.append(battery.voltage)
    assert (np.diff(idle) <= 0.0).all()


@given(st.floats(0.0, 3.0), st.floats(0.001, 3.0))
def test_a_larger_current_sags_the_voltage_more(current, more):
    light, heavy = Battery(), Battery()
    light.draw(current, 1e-3)
    heavy.draw(current + more, 1e-3)
    assert light.voltage - heavy.voltage == pytest.approx(0.6 * more, rel=1e-3)


def test_drawing_the_capacity_takes_a_fresh_battery_to_low():
    battery = Battery(battery_voltage=9.5, battery_resistance=0.0, idle_current=1)
    battery.draw(0.0, 7200.0)
    assert battery.voltage == pytest.approx(7.0)


def test_a_braking_motor_does_not_charge_the_battery():
    battery = Battery()
    battery.draw(-2.0, 100.0)
    assert battery.voltage < 8.0


def test_an_empty_battery_stays_at_zero_volts():
    battery = Battery()
    for _ in range(100):
        battery.draw(10.0, 3600.0)
    assert battery.voltage == 0.0


def test_a_robot_held_at_full_duty_drains_its_battery_continuously():
    truths = run_plant(make_plant(**DRAINING, hold_time=10.0), [(100, -100)] * 500)
    voltages = [truth.battery_voltage for truth in truths]
    assert voltages[1] < voltages[0] - 0.5
    assert (np.diff(voltages) <= 0.0).all()
    assert voltages[-1] < voltages[1]


@given(st.lists(st.integers(-100, 100), min_size=1, max_size=5), st.floats(1.0, 12.0))
def test_the_published_voltage_is_a_single_precision_number(duties, voltage):
    plant = make_plant(**DRAINING, battery_voltage=voltage)
    for truth in run_plant(plant, [(duty, 0) for duty in duties]):
        assert float(np.float32(truth.battery_voltage)) == truth.battery_voltage
