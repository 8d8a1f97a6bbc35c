"""The order and the times of the closed loop."""

import pytest
from parts import START_NS, make_loop, run_loop, step

from ballbot_ros.engine.scenario.scenario import Scenario
from ballbot_ros.parameters.timing import TICK_NS


def test_the_run_begins_at_one_second_and_ticks_every_four_milliseconds():
    stamps = [tick.truth.stamp_ns for tick in run_loop(make_loop({}), 0.1)]
    assert stamps == [START_NS + n * 4_000_000 for n in range(25)]


def test_slow_devices_answer_at_their_own_times():
    ticks = run_loop(make_loop({}), 1.0)
    for name, period in (('sonar_cm', 5), ('sticks', 5), ('battery_mv', 25)):
        sampled = [getattr(tick.inputs, name) is not None for tick in ticks]
        assert sampled == [n % period == 0 for n in range(len(ticks))]


def test_devices_read_the_truth_of_their_own_tick():
    ticks = run_loop(make_loop({'plant_sim.hold_time': 0.0, 'plant_sim.start_pitch_x': 0.1}), 0.2)
    for tick in ticks:
        assert abs(tick.inputs.gyro[0] - 600 - tick.truth.psi_rate[0] * 57.29577951) <= 0.5000001
        turned = tick.truth.motor_angle[0] * 57.29577951
        assert abs(tick.inputs.revolutions[0] - turned) <= 0.5000001
    assert ticks[-1].inputs.gyro[0] > 600
    assert ticks[0].inputs.battery_mv == 8003
    assert ticks[0].inputs.sonar_cm == 255


def test_a_duty_acts_from_its_tick_on():
    ticks = run_loop(make_loop({'plant_sim.hold_time': 10.0, 'gyro_driver.noise': 5.0}), 1.5)
    stall_torque = 0.317 / 6.69 * (0.001089 * 8000 - 0.625)
    duties = [tick.outputs.duty for tick in ticks]
    assert len(set(duties)) > 100
    for duty, tick in zip(duties, ticks[1:], strict=False):
        torque = tuple(stall_torque * each / 100 for each in duty)
        assert tick.truth.motor_torque == pytest.approx(torque)


def test_sticks_and_time_count_from_the_start_of_the_run():
    loop = make_loop({}, Scenario(vertical=step(0.02, 60)))
    ticks = run_loop(loop, 0.04)
    assert [tick.inputs.sticks for tick in ticks[::5]] == [(0, 0), (60, 0)]
    assert loop.program.state.systick_ms == 1000 + 36


def test_a_wall_ends_the_run():
    start = {'plant_sim.map': 'track', 'plant_sim.start_position_x': 0.7}
    loop = make_loop(start, Scenario(vertical=step(2.0, 100)))
    ticks = list(loop.ticks(20.0))
    assert loop.plant.stopped
    assert loop.plant.time_ns == START_NS + len(ticks) * TICK_NS
    assert len(ticks) < 5000
    assert list(loop.ticks(20.0)) == []


def test_the_plant_waits_for_the_devices_of_the_first_tick():
    loop = make_loop({'plant_sim.start_pitch_x': 0.05})
    tick = loop.tick()
    assert tick.truth.stamp_ns == START_NS
    assert tick.truth.psi == (0.05, 0.0)
    assert tick.inputs.gyro == (600, 600)
    assert tick.inputs.revolutions == (0, 0)
    assert len(tick.outputs.pages) == 1
