"""The commissioning program: its phases, what it logs, and the stand for it."""

import math
from dataclasses import fields

import pytest
from generated import SHORT, commissioning
from parts import AT_REST, tick

from ballbot_ros.controllers.codegen.implementation import compose_controller, implementation_for
from ballbot_ros.controllers.commissioning import (
    END,
    PLAY,
    PORTS,
    RAMP,
    TILT,
    CommissioningParameters,
    ramp_duty,
)
from ballbot_ros.engine.closed_loop import ClosedLoop
from ballbot_ros.engine.scenario.reader import load_profile
from ballbot_ros.parameters import CONTROLLER, GyroParameters, PlantParameters, SonarParameters
from ballbot_ros.robot.brick.sensors import NO_DATA_CM

TICKS = {0: 5, 1: 25, 2: 4 * 6, 3: 401, 4: 2 * 9 * 3, 5: 2 * 10}
"""Of each phase with the durations SHORT."""


@pytest.fixture(scope='module')
def run():
    """Phase and outputs of each tick, until some time after the end."""
    program = implementation_for(commissioning(**SHORT)).make()
    found = []
    for n in range(sum(TICKS.values()) + 20):
        inputs = AT_REST._replace(gyro=(600 + n % 3, 40_000), sticks=(100, 100), sonar_cm=30)
        found.append(tick(program, 4 * n, 1000 + 4 * n, inputs))
    phases = [phase for phase, ticks in TICKS.items() for _ in range(ticks)]
    return [*zip(phases + 20 * [END], found, strict=True)]


def duties(run, phase):
    return [outputs.duty for each, outputs in run if each == phase]


def test_each_phase_has_its_duties(run):
    for phase in (0, 1, TILT, END):
        assert {*duties(run, phase)} == {(0, 0)}
    assert duties(run, PORTS) == [*6 * [(30, 0)], *6 * [(0, 0)], *6 * [(0, 30)], *6 * [(0, 0)]]
    levels = [*range(101), *range(99, -101, -1), *range(-99, 1)]
    assert duties(run, RAMP) == [(level, level) for level in levels]
    levels = [40, 40, -40, -40, 41, 41, -41, -41, 42]
    pulses = [duty for level in levels for duty in (*3 * [level], 0, 0, 0)]
    assert duties(run, PLAY) == [(duty, duty) for duty in pulses]


def test_the_ramp_has_every_duty_and_ends_where_it_begins():
    assert [ramp_duty(step) for step in (0, 1, 100, 101, 200, 300, 301, 400)] == [
        0, 1, 100, 99, 0, -100, -99, 0,
    ]  # fmt: skip


def test_a_packet_every_20_ms_has_duties_phase_and_gyros_and_asks_no_sonar(run):
    for n, (phase, outputs) in enumerate(run):
        assert len(outputs.log) == (n % 5 == 0)
        for packet in outputs.log:
            assert (packet.data1, packet.data2) == outputs.duty
            assert (packet.adc1, packet.adc2) == (phase, 0)
            assert (packet.adc3, packet.adc4) == (600 + n % 3, 2**15 - 1)
            assert packet.sonar_cm == NO_DATA_CM


def test_a_tone_marks_each_phase_and_each_tilt(run):
    at = [n for n, (_, outputs) in enumerate(run) if outputs.tones]
    starts = [sum([*TICKS.values()][:number]) for number in range(END + 1)]
    assert at == sorted([*starts, starts[TILT] + 10])
    assert [run[n][1].tones[0].duration_ms for n in at] == [200] * 7 + [2000]


def test_the_stand_has_the_devices_of_the_hardware():
    stand, hardware = load_profile('stand'), load_profile('hardware')
    for cls in (GyroParameters, SonarParameters):
        assert stand.of(cls) == hardware.of(cls)
    other = {
        each.name
        for each in fields(PlantParameters)
        if getattr(stand.of(PlantParameters), each.name)
        != getattr(hardware.of(PlantParameters), each.name)
    }
    assert other == {
        'gravity', 'ball_mass', 'body_mass', 'body_height', 'ball_radius', 'wheel_radius',
        'hold_time',
    }  # fmt: skip
    p = stand.of(PlantParameters)
    assert p.ball_radius / p.wheel_radius == pytest.approx(26 / 21)


def test_on_the_stand_the_motors_run_free_and_the_body_stays_where_it_is():
    """The speed at a duty is that at which the back EMF and the motor's friction balance it."""
    parameters = load_profile('stand')
    short = {'pause_time': 0.1, 'rest_time': 0.1, 'port_time': 0.1, 'step_time': 0.04}
    parameters.set(CONTROLLER, 'implementation', 'commissioning')
    for name, value in short.items():
        parameters.set(CONTROLLER, f'user.{name}', value)
    compose_controller(parameters)
    p, loop = parameters.of(PlantParameters), ClosedLoop(parameters)
    slowing = p.back_emf_constant + p.motor_resistance * p.motor_friction / p.torque_constant
    speeds, pitch = {}, 0.0
    for number in range(25 + 25 + 100 + 401 * 10 + 10):
        truth = loop.tick().truth
        pitch = max(pitch, *map(abs, truth.psi))
        step, rest = divmod(number - 150, 10)
        if rest == 9 and 0 <= step <= 400:
            duty = ramp_duty(step)
            share = math.copysign(max(abs(duty) - p.dead_zone, 0.0), duty) / 100.0
            full = p.voltage_slope * 1000.0 * truth.battery_voltage + p.voltage_offset
            speeds[step] = (truth.motor_rate, share * full / slowing)
    assert len(speeds) == 401
    for step, (rates, expected) in speeds.items():
        assert rates == pytest.approx((expected, expected), abs=0.02), step
    assert max(abs(expected) for _, expected in speeds.values()) > 12.0
    assert math.degrees(pitch) < 0.5


def test_the_defaults_take_less_than_four_minutes():
    defaults = CommissioningParameters()
    assert defaults.rest_time >= 60.0
    ticks = implementation_for(commissioning()).make().controller.in_force.phase_ticks
    assert 180.0 < sum(ticks) * 0.004 < 240.0
