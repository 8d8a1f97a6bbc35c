"""Fits to logs of the commissioning program, from simulated robots on a stand."""

import math
import random
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st
from real_runs import write_real

from ballbot_ros.analysis.identification.commissioning import (
    BLOCK,
    Estimate,
    commission,
    pooled,
    volts_per_speed,
)
from ballbot_ros.analysis.identification.commissioning_figure import render_commissioning
from ballbot_ros.controllers.commissioning import END, PLAY, PORTS, RAMP, REST, TILT
from ballbot_ros.engine.devices import gyro_constants
from ballbot_ros.errors import IdentificationError
from ballbot_ros.parameters import GYRO, PLANT, GyroParameters
from ballbot_ros.robot.brick.bluetooth import LogPacket
from ballbot_ros.robot.brick.sensors import NO_DATA_CM, gyro_reading
from benchmark.commissioning import (
    BATTERIES_V,
    commissioned,
    drawn_robot,
    errors,
    known,
    simulated_log,
)

DURATIONS = {
    'pause_time': 0.02, 'rest_time': 0.02, 'port_time': 0.3, 'step_time': 0.08, 'play_time': 0.1,
    'tilt_time': 0.02,
}  # fmt: skip
ROBOTS = 4


@pytest.fixture(scope='module')
def motor_logs():
    """Packets of each robot, with a fresh and a nearly empty battery."""
    return [
        [simulated_log(drawn_robot(n), volts, 1, DURATIONS) for volts in BATTERIES_V]
        for n in range(ROBOTS)
    ]


def at_rest(gyro, numbers=range(6000), first_ms=1000):
    """Return the packets of a resting robot, one every 20 ms."""
    constants = gyro_constants(gyro)
    draw = random.Random(first_ms)
    return [
        packet(
            first_ms + 20 * n, REST,
            gyro=[
                gyro_reading(each, 0.0, draw.gauss(0.0, 1.0), (first_ms + 20 * n) * 1_000_000)
                for each in (constants.x, constants.y)
            ],
        )
        for n in numbers
    ]  # fmt: skip


def after(first, log):
    """Return the phases of a log after its rest, later than another log."""
    start = first[-1].time_ms + 20
    later = [each for each in log if each.adc1 > REST]
    return [
        replace(each, time_ms=start + each.time_ms - later[0].time_ms) for each in later
    ]  # fmt: skip


def packet(time_ms, phase, duty=(0, 0), turned=(0, 0), gyro=(600, 600)):
    """Return a packet of the commissioning program."""
    return LogPacket(time_ms, *duty, 8000, 0, *turned, phase, 0, *gyro, NO_DATA_CM)


def estimates(found):
    return {each.name: each.estimate for each in found.parameters}


def covered(estimate, true):
    return abs(estimate.value - true) <= estimate.half_width


def test_intervals_of_motors_cover_the_truth(motor_logs):
    """At least 90 % of them, and they are narrow."""
    told = []
    for number, logs in enumerate(motor_logs):
        found = commissioned(logs)
        assert len(found.parameters) == 4
        told += [error <= half for _, error, half in errors(found, drawn_robot(number))]
        half_widths = {name: each.half_width for name, each in estimates(found).items()}
        assert half_widths['dead_zone'] < 0.2
        assert half_widths['voltage_slope'] < 2e-5
        assert math.degrees(half_widths['backlash']) < 0.5
    assert sum(told) >= 0.9 * len(told)


def test_intervals_of_resting_gyros_cover_the_truth():
    """At least 90 % of them, with noise from a third of the rounding on."""
    told = []
    for number in range(6):
        robot = {name: value for (node, name), value in drawn_robot(number).items() if node == GYRO}
        gyro = GyroParameters(**robot, seed=number)
        logs = [at_rest(gyro, first_ms=first) for first in (1000 + number, 300_000 + number)]
        found = estimates(commissioned(logs))
        assert found.keys() == robot.keys()
        told += [covered(each, robot[name]) for name, each in found.items()]
        assert max(each.half_width for each in found.values()) < 0.2
    assert sum(told) >= 0.9 * len(told)


def test_lost_packets_change_no_more_than_their_number_says(motor_logs):
    whole = commissioned(motor_logs[0])
    draw = random.Random(1)
    kept = [[each for each in log if draw.random() > 0.05] for log in motor_logs[0]]
    assert all(len(part) < len(log) for part, log in zip(kept, motor_logs[0], strict=True))
    found = estimates(commissioned(kept))
    for name, estimate in estimates(whole).items():
        assert abs(found[name].value - estimate.value) < estimate.half_width
        assert found[name].half_width < 2.0 * estimate.half_width


def test_one_battery_voltage_keeps_the_slope_of_the_profile(motor_logs):
    plant, _ = known()
    found = commissioned([motor_logs[0][0]])
    assert 'voltage_slope' not in estimates(found)
    assert 'too alike to tell the slope' in ' '.join(found.notes)
    ramp = found.ramps['motor B']
    assert ramp.slope.value == 1000.0 * plant.voltage_slope / volts_per_speed(plant)
    full = ramp.duty == 100.0
    assert ramp.speed_at(ramp.duty, ramp.battery)[full] == pytest.approx(ramp.speed[full], rel=0.01)


@pytest.mark.parametrize('noise', [0.0, 0.15])
def test_nothing_is_known_of_gyros_whose_readings_hardly_change(motor_logs, noise):
    """They are not connected, or the rounding hides where in a degree the offset is."""
    rest = at_rest(GyroParameters(noise=noise, drift=0.3), range(3100))
    found = commissioned([rest + after(rest, motor_logs[0][0])])
    assert {each.node for each in found.parameters} == {PLANT}
    assert 'in which both gyros scatter like noise' in found.notes[0]
    with pytest.raises(IdentificationError, match='check the cables'):
        commissioned([rest])


def test_a_bump_of_the_table_does_not_matter_much():
    calm = at_rest(GyroParameters(noise=0.7))
    bumped = [replace(each, adc3=each.adc3 + 10 * (n == 3000)) for n, each in enumerate(calm)]
    whole, found = (estimates(commissioned([log])) for log in (calm, bumped))
    for name, estimate in found.items():
        assert abs(estimate.value - whole[name].value) < 3.0 * whole[name].half_width
        assert estimate.half_width < 2.0 * whole[name].half_width


def test_a_drift_that_is_no_sine_widens_the_intervals_and_is_noted():
    gyro = GyroParameters(noise=0.7)
    calm, steps = (
        commissioned([[
            replace(each, adc3=each.adc3 + step * (n // (10 * BLOCK) % 2))
            for n, each in enumerate(at_rest(gyro))
        ]])
        for step in (0, 2)
    )  # fmt: skip
    assert 'not a sine' not in ' '.join(calm.notes)
    assert 'for a period of 300 s' in ' '.join(calm.notes)
    assert 'not a sine' in ' '.join(steps.notes)
    x, y = (estimates(steps)[f'zero_rate_offset_{axis}'].half_width for axis in 'xy')
    assert x > 2.0 * y


@given(st.lists(st.tuples(st.floats(-100.0, 100.0), st.floats(0.1, 10.0)), min_size=1, max_size=5))
def test_a_pooled_value_is_between_all_and_no_wider_than_their_spread(pairs):
    each = [Estimate(*pair) for pair in pairs]
    values, half_widths = zip(*pairs, strict=True)
    found, dependent = pooled(each), pooled(each, independent=False)
    assert min(values) - 1e-9 <= found.value <= max(values) + 1e-9
    assert dependent.value == found.value
    assert dependent.half_width == pytest.approx(found.half_width * math.sqrt(len(pairs)))
    assert found.half_width >= (1.0 - 1e-9) / math.sqrt(sum(each**-2 for each in half_widths))
    if len(pairs) == 1:
        assert found == pytest.approx(each[0])


def pulses(turned_b, turned_c):
    """Return the packets of the pulses on one motor alone, which turn B and C so far [deg]."""
    found, sum_b, sum_c = [], 0, 0
    for duty, b, c in (((30, 0), *turned_b), ((0, 0), 0, 0), ((0, 30), *turned_c), ((0, 0), 0, 0)):
        for _ in range(10):
            found.append((duty, (sum_b, sum_c)))
            sum_b, sum_c = sum_b + b // 10, sum_c + c // 10
    return found


@pytest.mark.parametrize(
    ('turned_b', 'turned_c', 'told'),
    [
        ((200, 0), (0, 200), ['B by +200° and C by +0°', 'B by +0° and C by +200°']),
        ((0, 200), (200, 0), ['only motor B may turn', 'only motor C may turn']),
        ((-200, 0), (0, 0), ['motor B must turn that way', 'motor C must turn that way']),
    ],
)
def test_pulses_on_one_motor_alone_show_its_port_and_sign(turned_b, turned_c, told):
    log = at_rest(GyroParameters(noise=0.7), range(3100))
    start = log[-1].time_ms + 20
    log += [
        packet(start + 20 * n, PORTS, duty, turned)
        for n, (duty, turned) in enumerate(pulses(turned_b, turned_c))
    ]
    checks = commissioned([log]).checks
    assert len(checks) == 2
    assert all(line.endswith(end) for line, end in zip(checks, told, strict=True)), checks


@pytest.mark.parametrize(
    ('forward', 'rightward', 'told'),
    [
        ((30, 0), (-30, 30), ['gyro x saw +30° and gyro y +0°', 'gyro y saw +30°']),
        ((0, 0), (0, 0), ['nothing is known of the ports and signs of the gyros']),
        ((0, 30), (30, 0), ['wrong, each is in the port of the other']),
        ((-30, 1), (0, -30), ['gyro x is mounted the other', 'gyro y is mounted the other']),
    ],
)
def test_tilting_shows_the_ports_and_signs_of_the_gyros(forward, rightward, told):
    log = at_rest(GyroParameters(noise=0.7), range(3100))
    start = log[-1].time_ms + 20
    for n in range(200):
        rates = forward if n < 100 else rightward  # for 1 s of 2 s
        moving = n % 100 >= 50
        log.append(packet(start + 20 * n, TILT, gyro=[600 + rate * moving for rate in rates]))
    checks = commissioned([log]).checks
    assert len(checks) == len(told)
    assert all(part in line for line, part in zip(checks, told, strict=True)), checks


def test_a_motor_that_does_not_turn_is_left_out(motor_logs):
    logs = [[replace(each, rev_c=7) for each in log] for log in motor_logs[0]]
    found = commissioned(logs)
    assert found.ramps.keys() == found.plays.keys() == {'motor B'}
    assert 'no ramp turned motor C forward, so nothing is known of its speed' in found.notes
    assert sum('motor C must turn that way' in line for line in found.checks) == len(logs)
    whole = estimates(commissioned(motor_logs[0]))
    for name, estimate in estimates(found).items():
        assert estimate.value == pytest.approx(whole[name].value, rel=1e-6)
    assert render_commissioning(found).startswith(b'\x89PNG')


def test_a_motor_that_turns_backward_is_left_out(motor_logs):
    logs = [[replace(each, rev_b=-each.rev_b) for each in log] for log in motor_logs[0]]
    found = commissioned(logs)
    assert found.ramps.keys() == found.plays.keys() == {'motor C'}
    assert any('no ramp turned motor B forward' in note for note in found.notes)
    assert sum('motor B must turn that way' in line for line in found.checks) == len(logs)


@pytest.mark.parametrize('late', [0.004, 0.016])
def test_gear_play_needs_no_log_packet_at_the_beginning_of_a_pulse(late):
    robot = drawn_robot(1)
    durations = {**DURATIONS, 'pause_time': 0.02 + late, 'step_time': 0.02}
    play = estimates(commissioned([simulated_log(robot, 9.3, 1, durations)]))['backlash']
    assert covered(play, robot[PLANT, 'backlash'])
    assert math.degrees(play.half_width) < 0.5


def test_no_gear_play_is_known_within_the_rounding_of_the_encoder(motor_logs):
    """A motor that always turns by the same angle has scattered readings all the same."""
    log = [each for each in motor_logs[0][0] if each.adc1 == PLAY]
    starts = [n for n, each in enumerate(log) if n and (not log[n - 1].data1) and each.data1]
    angles = {
        n: sum(20 if log[m].data1 > 0 else -20 for m in starts if m < n) for n in range(len(log))
    }
    found = commissioned(
        [[replace(each, rev_b=angles[n], rev_c=angles[n]) for n, each in enumerate(log)]]
    )
    play = estimates(found)['backlash']
    assert play.value == 0.0
    assert 0.0 < math.degrees(play.half_width) < 0.5


def test_a_recording_tells_the_same_as_its_data_log(tmp_path, motor_logs):
    (log,) = motor_logs[0][:1]
    recording = write_real(tmp_path / 'real.mcap', log, log_content='duties_and_gyros')
    found = commission([recording], *known())
    assert found.parameters == commissioned([log]).parameters
    assert render_commissioning(found).startswith(b'\x89PNG')


@pytest.mark.parametrize(
    ('change', 'told'),
    [
        (lambda log: [replace(each, adc2=1) for each in log], 'not a log of the commissioning'),
        (
            lambda log: [replace(each, adc3=0, adc4=0) for each in log],
            'not a log of the commissioning',
        ),
        (lambda log: [replace(each, adc1=END + 1) for each in log], 'not a log of the comm'),
        (lambda log: [replace(each, adc1=each.time_ms // 20 % 2) for each in log], 'not a log of'),
        (lambda log: log[:1], 'not a log of the commissioning program'),
        (lambda log: log[:100], 'ends before its phases have told anything'),
    ],
)
def test_another_log_is_refused_in_one_line(change, told):
    with pytest.raises(IdentificationError, match=told) as error:
        commissioned([change(at_rest(GyroParameters(), range(3100)))])
    assert '\n' not in str(error.value)


def test_a_log_that_ends_early_tells_what_it_has(motor_logs):
    log = [each for each in motor_logs[0][0] if each.adc1 <= RAMP]
    found = commissioned([log])
    assert estimates(found).keys() == {'dead_zone', 'voltage_offset'}
    assert len([note for note in found.notes if 'of its gear play' in note]) == 2
    assert [note for note in found.notes if 'no rest of 60 s' in note]
    assert GYRO not in {each.node for each in found.parameters}
