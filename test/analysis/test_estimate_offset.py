"""Why the estimated pitch of a run is off: the causes are known, and add up."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from hypothesis import strategies as st
from laws import given

from ballbot_ros.analysis.figure_parts import Interval
from ballbot_ros.analysis.observations import (
    EstimatedTicks,
    EstimateStart,
    OffsetParts,
    decompose,
    estimate_offset,
    offset_reasons,
)
from ballbot_ros.analysis.run_data import Series, read_run
from ballbot_ros.analysis.run_metrics import pitch_error, position_error
from ballbot_ros.lockstep.run_actions import ParameterChange
from ballbot_ros.parameters import CONTROLLER, ControllerParameters
from ballbot_ros.recording.messages.topics import CONTROLLER_STATE, GYRO_IMU, PLANT_IMU, PLANT_ODOM

TICK_S = 0.004
PITCH = st.floats(-10.0, 10.0)
RATE = st.floats(-3.0, 3.0)
COEFFICIENT = st.sampled_from([0.0, 0.5, 0.99, 0.999, 1.0])
TOPICS = {PLANT_IMU, GYRO_IMU, CONTROLLER_STATE}


def program(reading, offset, a, number=float):
    """The pitch [°] of the document's program, in numbers of a type, from an offset [deg/s] on."""
    moved, a = number(1.0) - number(a), number(a)
    offset, total, pitch = number(offset), number(0.0), []
    for each in map(number, reading):
        pitch.append(number(4.0) * total / number(1000.0))
        offset = each * moved + a * offset
        total = each - offset + total
    return np.array(pitch)


def parts_of(pitch, offset, noise, calibrated, a, block=100):
    """The parts of the mean error in a plane, and that error itself [°]."""
    rate = np.append(np.diff(pitch) / TICK_S, 0.0)
    reading = rate + offset + noise
    estimate = program(reading, calibrated, a)
    ticks = [np.column_stack([each, each]) for each in (estimate, pitch, reading, rate, offset)]
    start = EstimateStart(ticks[0][0], ticks[1][0], np.full(2, calibrated), ticks[4][0])
    count = len(pitch)
    blocks = (
        EstimatedTicks(*(each[row : row + block] for each in ticks))
        for row in range(0, count, block)
    )
    x, y = decompose(start, blocks, count, a)
    assert x == y
    return x, float(np.mean(estimate - pitch))


def swing(seed, count, start=0.0):
    """A pitch [°] that wanders, from the given one on."""
    random = np.random.default_rng(seed)
    pitch = np.cumsum(random.normal(size=count)) * 0.01
    return start + pitch - pitch[0]


@given(st.integers(0, 2**32 - 1), PITCH, RATE, RATE, COEFFICIENT, st.integers(2, 700))
def test_the_parts_are_the_mean_error(seed, start, bias, drift, a, count):
    pitch = swing(seed, count, start)
    noise = np.random.default_rng(seed + 1).normal(size=count)
    offset = 600.0 + np.linspace(0.0, drift, count)
    parts, error = parts_of(pitch, offset, noise, 600.0 + bias, a)
    assert parts.total == pytest.approx(error, abs=1e-9)
    assert parts.single_precision == pytest.approx(0.0, abs=1e-8)  # the program here has none
    assert abs(parts.remainder) <= max(0.02, 0.05 * sum(map(abs, parts)))


@given(st.integers(0, 2**32 - 1), PITCH, RATE, COEFFICIENT)
def test_the_length_of_the_blocks_does_not_matter(seed, start, bias, a):
    pitch, noise = swing(seed, 300, start), swing(seed + 1, 300)
    given_block = partial(parts_of, pitch, np.full(300, 600.0), noise, 600.0 + bias, a)
    assert given_block(block=7)[0] == pytest.approx(given_block(block=300)[0], abs=1e-9)


@given(PITCH, COEFFICIENT)
def test_a_steady_pitch_is_taken_for_zero(start, a):
    parts, error = parts_of(np.full(400, start), np.full(400, 600.0), np.zeros(400), 600.0, a)
    fading = -start * np.mean(a ** np.arange(400.0))
    assert parts.start_pitch == pytest.approx(fading, abs=1e-9)
    # As it fades, the estimate stays at 0, and the pitch becomes a lasting one.
    assert error == pytest.approx(-start, abs=1e-9)
    assert parts.lasting_pitch == pytest.approx(-start - fading, abs=1e-9)


@given(RATE)
def test_an_error_of_the_calibration_stays_as_four_degrees_for_each_degree_per_second(bias):
    parts, error = parts_of(
        np.zeros(20_000), np.full(20_000, 600.0), np.zeros(20_000), 600.0 - bias, 0.999
    )
    assert error == pytest.approx(parts.calibration, abs=1e-8)
    assert parts.calibration == pytest.approx(3.996 * bias, rel=0.06)


@given(RATE, COEFFICIENT)
def test_drift_and_noise_are_told_apart(drift, a):
    still = np.zeros(500)
    drifting, error = parts_of(still, 600.0 + np.linspace(0.0, drift, 500), still, 600.0, a)
    assert drifting.drift == pytest.approx(error, abs=1e-9)
    noisy, error = parts_of(still, still + 600.0, np.linspace(0.0, drift, 500), 600.0, a)
    assert noisy.noise == pytest.approx(error, abs=1e-9)
    assert noisy.noise == pytest.approx(drifting.drift, abs=1e-9)


def largest(parts):
    return max(OffsetParts._fields, key=lambda name: abs(getattr(parts, name)))


def check(run):
    """Check the parts of a run against its measured error; return them."""
    _, parts = estimate_offset(run)
    measured = np.nanmean(np.degrees(pitch_error(run)), axis=0)
    assert [each.total for each in parts] == pytest.approx(measured, abs=1e-6)
    for each in parts:
        assert abs(each.remainder) <= max(0.02, 0.05 * sum(map(abs, each)))
    return parts


def test_the_start_pitch_is_taken_for_zero(short_assessment):
    run = short_assessment.run
    x, y = check(run)
    assert largest(x) == 'start_pitch'
    assert x.start_pitch == pytest.approx(-3.15, abs=0.01)
    assert y == pytest.approx([0.0] * len(y), abs=1e-3)
    in_x, in_y = offset_reasons(run)
    assert in_x == (
        'Plane x: the estimated pitch is 3.18° below the true one on average: '
        '−3.15° from the pitch of 4.00° at the start, which the program takes for 0.'
    )
    assert in_y == 'Plane y: the estimated pitch is right within 0.05° on average.'


def test_noise_in_the_calibration_offsets_the_plane_at_rest(driven):
    x, y = check(read_run(driven[0]))
    assert largest(y) == 'calibration'
    assert abs(x.lasting_pitch) < 0.05


def test_a_gyro_between_two_counts_is_calibrated_wrongly(make_run):
    path, _ = make_run('forward_backward', '--set=gyro_driver.zero_rate_offset_x=600.4')
    run = read_run(path)
    x, _ = check(run)
    assert largest(x) == 'calibration'
    # At rest the gyro reads 600, in motion 600.4 on average.
    in_x, _ = offset_reasons(run)
    assert 'from the calibration, whose gyro offset is 0.40 deg/s too low' in in_x


def test_drift_is_named(make_run):
    path, _ = make_run(
        'stationary',
        '--profile=hardware',
        '--set=gyro_driver.drift=2.0',
        '--set=gyro_driver.drift_period=120.0',
        '--set=plant_sim.duration=30',
    )
    run = read_run(path)
    parts = check(run)
    assert [largest(each) for each in parts] == ['drift', 'drift']
    for sentence in offset_reasons(run):
        first, *_ = sentence.partition(': ')[2].partition(': ')[2].split(';')
        assert first.endswith('from the drift of the gyro since the calibration')


def test_without_a_low_pass_the_start_pitch_stays(make_run):
    path, _ = make_run('stationary', '--set=controller.a_gd=1.0', '--set=plant_sim.duration=10')
    x, _ = check(read_run(path))
    assert x.start_pitch == pytest.approx(-4.0, abs=0.01)
    assert x.total == pytest.approx(-4.0, abs=0.05)


def test_rounding_in_single_precision_adds_up(make_run):
    path, _ = make_run('stationary', '--set=plant_sim.duration=120')
    run = read_run(path)
    x, _ = check(run)
    assert largest(x) == 'single_precision'
    estimate = np.degrees(run.series[CONTROLLER_STATE].values[250:, 1])
    reading = np.rint(np.degrees(run.series[GYRO_IMU].values[250:, 0]))
    a = np.float32(0.999)
    assert program(reading, 600, a, np.float32) == pytest.approx(estimate, abs=1e-5)
    rounding = np.mean(estimate - program(reading, 600, a))
    assert x.single_precision == pytest.approx(rounding, abs=1e-3)
    assert rounding == pytest.approx(0.162, abs=0.005)


def test_another_controller_has_no_reasons(short_assessment):
    run = short_assessment.run
    run = replace(run, attached=replace(run.attached, external={'controller': 'theirs'}))
    assert estimate_offset(run) is None
    for plane, sentence in zip('xy', offset_reasons(run), strict=True):
        assert sentence.startswith(f'Plane {plane}: the estimated pitch is ')
        assert ': −' not in sentence
        assert ': +' not in sentence


def with_rows(run, topic, kept):
    """The run with only some rows of a topic."""
    old = run.series[topic]
    series = Series(old.stamps[kept], old.time[kept], old.values[kept])
    return replace(run, series={**run.series, topic: series})


@pytest.mark.parametrize('topic', sorted(TOPICS, key=str))
@pytest.mark.parametrize('lost', [slice(400, 401), slice(0, 400)])
def test_with_ticks_missing_there_are_no_reasons(short_assessment, topic, lost):
    run = short_assessment.run
    kept = np.delete(np.arange(len(run.series[topic].stamps)), lost)
    run = with_rows(run, topic, kept)
    assert estimate_offset(run) is None
    assert all(': −' not in sentence for sentence in offset_reasons(run))


def test_what_changes_the_estimate_leaves_no_reasons(short_assessment):
    run = short_assessment.run
    for name, is_known in (('k_i', True), ('a_gd', False)):
        change = ParameterChange(1.5, CONTROLLER, name, 0.99)
        found = estimate_offset(replace(run, parameter_changes=(change,)))
        assert (found is not None) == is_known
    foreign = replace(run.attached, external={'gyro_driver': 'theirs'})
    assert estimate_offset(replace(run, attached=foreign)) is None


def test_without_topics_or_balancing_there_is_nothing_to_say(short_assessment):
    run = short_assessment.run
    for topic in (CONTROLLER_STATE, PLANT_IMU):
        series = {name: each for name, each in run.series.items() if name != topic}
        assert offset_reasons(replace(run, series=series)) == []
    never = (Interval(0.0, 3.0, 'calibration'),)
    assert offset_reasons(replace(run, states=never)) == []
    series = {name: each for name, each in run.series.items() if name != GYRO_IMU}
    in_x, _ = offset_reasons(replace(run, series=series))
    assert in_x == 'Plane x: the estimated pitch is 3.18° below the true one on average.'


def test_the_position_is_off_by_the_pitch_since_the_start(make_run):
    path, _ = make_run('stationary', '--set=plant_sim.duration=20')
    run = read_run(path)
    x, _ = check(run)
    radius = run.attached.parameters.of(ControllerParameters).ball_radius
    measured = np.nanmean(position_error(run)[:, 0])
    assert measured == pytest.approx(radius * np.radians(4.0 + x.total), rel=0.03)
    in_x, in_y = offset_reasons(run)
    assert in_x.endswith(f' is off by +{measured * 1e3:.1f} mm on average.')
    assert 'position' not in in_y
    series = {name: each for name, each in run.series.items() if name != PLANT_ODOM}
    assert 'position' not in offset_reasons(replace(run, series=series))[0]
