"""A data log as an experiment: gaps, the time in which the robot balances, gear play."""

import math

import numpy as np
import pytest
from laws import refusal

import ballbot_ros.analysis.identification.segments as segments_module
from ballbot_ros.analysis.identification.estimation import ExperimentFit
from ballbot_ros.analysis.identification.experiment import (
    INTERPOLATED_DUTIES,
    LOGGED_ENCODER,
    LOGGED_PITCH,
    NO_DUTIES,
    SELDOM_DUTIES,
    UNKNOWN_PHASE,
    Experiment,
    logged_experiment,
)
from ballbot_ros.analysis.identification.segment_model import SegmentModel
from ballbot_ros.analysis.identification.segments import _starts, cut
from ballbot_ros.engine.plant import Plant
from ballbot_ros.errors import IdentificationError
from ballbot_ros.parameters import ControllerParameters, PlantParameters
from ballbot_ros.parameters.timing import FIRST_TICK_NS, TICK_S
from ballbot_ros.recording.csv_log import write_csv_log
from ballbot_ros.robot.brick.bluetooth import LogPacket
from ballbot_ros.robot.plant.ground_truth import state_before
from ballbot_ros.robot.plant.laws import max_voltage

LSB = ControllerParameters().lsb


def written(path, records):
    """Return a log of records: time [ms], angles of both shafts, pitch of both planes [deg]."""
    packets = []
    for time, shaft_x, shaft_y, pitch_x, pitch_y in records:
        counts = round(pitch_x / LSB), round(pitch_y / LSB)
        packets.append(LogPacket(time, 0, 0, 8000, 0, shaft_x, shaft_y, *counts, 0, 0, 255))
    write_csv_log(path, packets)
    return path


def with_duties(path, times, duties, shaft=lambda n: n):
    """Return a log of records with the same duties in both planes but for the sign."""
    packets = [
        LogPacket(time, duty, -duty, 8003, 0, shaft(n), n, 100 * n, 0, 600, 600, 255)
        for n, (time, duty) in enumerate(zip(times, duties, strict=True))
    ]
    write_csv_log(path, packets)
    return path


def values(experiment, name):
    return next(each for channel, each in experiment.readings.items() if channel.name == name)


def test_readings_and_their_times(tmp_path):
    path = written(tmp_path / 'log.csv', [(2004 + 90 * n, n, -n, 0.5 * n, -n) for n in range(5)])
    experiment = logged_experiment(path, {'body_mass': 0.7})
    assert experiment.reading_s == pytest.approx(0.09)
    assert experiment.step_s <= TICK_S
    assert experiment.plant.body_mass == 0.7
    numbers = np.arange(5.0)
    np.testing.assert_array_equal(values(experiment, 'encoder'), np.array([numbers, -numbers]).T)
    np.testing.assert_allclose(
        values(experiment, 'estimated pitch'), np.array([0.5 * numbers, -numbers]).T, atol=LSB
    )


def test_it_is_usable_from_the_first_turn_until_the_fall(tmp_path):
    pitches = [0, 0, 1, 2, 31, 32, 0]
    path = written(
        tmp_path / 'log.csv',
        [(100 * n, 0, int(n >= 2), 0.0, min(p, 31.9)) for n, p in enumerate(pitches)],
    )
    usable = logged_experiment(path, {}).usable
    assert usable.tolist() == [False, False, True, True, False, False, False]


def test_gaps_separate_the_records_on_both_sides(tmp_path):
    times = [0, 100, 202, 399, 500, 550, 648]
    path = written(tmp_path / 'log.csv', [(time, time, 0, 0.0, 0.0) for time in times])
    experiment = logged_experiment(path, {})
    assert experiment.usable.tolist() == [False, True, True, False, True, True, False, True, True]
    assert np.isnan(values(experiment, 'encoder')[[3, 6]]).all()
    assert any('2 gaps between records' in note for note in experiment.notes)


def test_of_a_log_of_every_tick_some_records_are_used(tmp_path):
    times = [4 * n + 1000 * (n >= 50) for n in range(111)]
    path = written(tmp_path / 'log.csv', [(time, time, 0, 0.0, 0.0) for time in times])
    experiment = logged_experiment(path, {})
    assert experiment.reading_s == pytest.approx(0.08)
    nan = math.nan
    np.testing.assert_array_equal(
        values(experiment, 'encoder')[:, 0], [0, 80, 160, nan, 1200, 1280, 1360, 1440]
    )
    assert not experiment.usable[3]


def test_the_clock_of_the_brick_may_wrap_around(tmp_path):
    times = [2**32 - 150, 2**32 - 50, 50, 150]
    path = written(tmp_path / 'log.csv', [(time, 0, 0, 0.0, 0.0) for time in times])
    experiment = logged_experiment(path, {})
    assert len(experiment.usable) == 4
    assert not any('gap' in note for note in experiment.notes)


def test_gear_play_is_known_where_the_shaft_turns_one_way(tmp_path):
    shaft = [0, 5, 10, 10, 8, 4, 9]
    path = written(tmp_path / 'log.csv', [(100 * n, s, 0, 0.0, 0.0) for n, s in enumerate(shaft)])
    experiment = logged_experiment(path, {'backlash': math.radians(4.0)})
    nan = math.nan
    np.testing.assert_array_equal(
        values(experiment, 'encoder')[:, 0].round(9), [2, 7, nan, nan, 6, nan, 11]
    )
    assert np.isnan(values(experiment, 'encoder')[:, 1]).all()
    assert experiment.plant.backlash == 0.0


def test_with_duties_each_tick_is_a_reading_of_the_known_motors(tmp_path):
    path = with_duties(tmp_path / 'log.csv', [2**32 - 8, 2**32 - 4, 0, 4], [3, -100, 0, 7])
    experiment = logged_experiment(path, {'body_mass': 0.7})
    assert experiment.reading_s == TICK_S
    assert experiment.duty.tolist() == [[3, -3], [-100, 100], [0, 0], [7, -7]]
    assert values(experiment, 'encoder').tolist() == [[n, n] for n in range(4)]
    np.testing.assert_allclose(
        values(experiment, 'estimated pitch')[:, 0], 100 * LSB * np.arange(4)
    )
    np.testing.assert_allclose(experiment.battery, 8.003)
    assert experiment.plant.body_mass == 0.7
    assert (experiment.interval_factor, *experiment.notes) == UNKNOWN_PHASE


def test_duties_between_records_are_interpolated_but_no_readings(tmp_path):
    path = with_duties(tmp_path / 'log.csv', [1000, 1020, 1040], [0, 10, -4])
    experiment = logged_experiment(path, {})
    assert experiment.duty[:, 0].tolist() == [0, 2, 4, 6, 8, 10, 7, 4, 2, -1, -4]
    read = ~np.isnan(values(experiment, 'encoder')[:, 0])
    assert np.flatnonzero(read).tolist() == [0, 5, 10]
    assert (experiment.interval_factor, *experiment.notes) == INTERPOLATED_DUTIES


def test_no_segment_crosses_a_gap_in_a_log_with_duties(tmp_path):
    path = with_duties(
        tmp_path / 'log.csv', [1000, 1020, 1042, 1060, 90_000_000, 90_000_020], [1] * 6
    )
    experiment = logged_experiment(path, {})
    # From the first turn on; the gap is as long as two steps.
    assert experiment.usable.tolist() == [False] + 14 * [True] + 10 * [False] + 6 * [True]
    assert any('1 gap between records' in note for note in experiment.notes)


def test_a_log_with_duties_is_that_of_a_brick_unless_told_otherwise(tmp_path):
    path = with_duties(tmp_path / 'log.csv', [1000, 1004], [1, 1])
    brick = logged_experiment(path, {})
    assert brick.plant.battery_model == 'draining'
    # Between those of both phases of the link.
    assert brick.delays_us[0] == pytest.approx(1736)
    assert brick.ages[LOGGED_PITCH] == pytest.approx(3.05)
    odd = logged_experiment(path, {'link_phase': 1})
    assert odd.interval_factor == 1.0
    assert odd.notes == ()
    assert (odd.delays_us[0], odd.ages[LOGGED_PITCH]) == (1236, pytest.approx(3.55))
    ideal = {'link': False, 'kernel': False, 'battery_model': 'constant'}
    experiment = logged_experiment(path, ideal)
    assert experiment.plant.battery_model == 'constant'
    assert (experiment.delays_us[0], experiment.ages[LOGGED_PITCH]) == (0, 0.0)


@pytest.mark.parametrize(
    ('period', 'duty', 'note'),
    [(24, 5, SELDOM_DUTIES), (100, 5, SELDOM_DUTIES), (20, 0, NO_DUTIES), (100, 0, NO_DUTIES)],
)
def test_of_duties_that_are_too_far_apart_or_missing_none_is_used(tmp_path, period, duty, note):
    times = range(1000, 1000 + 40 * period, period)
    experiment = logged_experiment(with_duties(tmp_path / 'log.csv', times, [duty] * 40), {})
    assert experiment.duty is None
    assert experiment.notes == (note,)
    assert 'nothing of motors, dead zone' in note


def test_gears_are_in_contact_where_records_show_a_shaft_that_turns(tmp_path):
    path = with_duties(
        tmp_path / 'log.csv', range(0, 1000, 20), [1] * 50, shaft=lambda n: n // 20 * n
    )
    begins, contact = _starts(logged_experiment(path, {'backlash': 0.07}))
    assert np.flatnonzero(begins)[0] == 5 * 22
    assert np.flatnonzero(begins).tolist() == list(range(110, 246, 5))
    assert (contact[begins] == -1.0).all()


def test_a_log_needs_two_records(tmp_path):
    path = written(tmp_path / 'log.csv', [(100, 0, 0, 0.0, 0.0)])
    message = refusal(IdentificationError, logged_experiment, path, {})
    assert 'has 1 records; at least 2' in message


def test_with_its_true_voltages_a_segment_moves_as_the_plant_does(monkeypatch):
    """The estimated pitch is that of the controller: a sum of rates less their low pass."""
    monkeypatch.setattr(segments_module, 'UNDRIVEN_SEGMENT_S', 0.8)
    parameters = PlantParameters(hold_time=0.0)
    plant, duty, per_reading = Plant(parameters, FIRST_TICK_NS), (3, -4), 25
    a_gd = ControllerParameters().a_gd
    offset, estimate = np.zeros(2), np.zeros(2)
    plant.keep_steps(1)
    start = plant.state
    shaft, pitch = [], []
    for tick in range(8 * per_reading):
        truth = plant.truth()
        if tick % per_reading == 0:
            shaft.append(np.degrees(state_before(truth.steps, 0).motor_angle))
            pitch.append(estimate.copy())
        rate = np.degrees(state_before(truth.steps, 0).psi_rate)
        offset = a_gd * offset + (1.0 - a_gd) * rate
        estimate += TICK_S * (rate - offset)
        plant.tick(*duty)
    experiment = Experiment(
        name='test', plant=parameters, duty=None,
        readings={LOGGED_PITCH: np.array(pitch), LOGGED_ENCODER: np.array(shaft)},
        battery=np.full(8, np.nan), battery_count=0.0, usable=np.ones(8, np.bool_),
        steps_per_reading=per_reading, step_s=TICK_S,
    )  # fmt: skip
    segments = cut(experiment)
    assert (segments.count, segments.length) == (1, 8)
    full = max_voltage(
        parameters.battery_voltage, parameters.voltage_slope, parameters.voltage_offset
    )
    planes = [
        [*plane, 0.0, 0.0, *7 * [percent / 100.0 * full]]
        for plane, percent in zip((start.x, start.y), duty, strict=True)
    ]
    unknowns = np.array([*planes[0], *planes[1], parameters.battery_voltage])
    predicted = SegmentModel(segments).predict([parameters], unknowns[np.newaxis, np.newaxis])
    np.testing.assert_allclose(
        predicted.readings[LOGGED_ENCODER][0, 0], np.array(shaft), rtol=0.0, atol=1e-9
    )
    # The program takes the offset of the present tick, the model that of the tick before.
    assert np.abs(pitch).max() > 0.3
    np.testing.assert_allclose(
        predicted.readings[LOGGED_PITCH][0, 0],
        np.array(pitch),
        rtol=(1.0 - a_gd) * 1.01,
        atol=1e-12,
    )


def test_readings_without_sense_have_some_solution(tmp_path):
    """Their rounding would drown small differences."""
    random = np.random.default_rng(3)
    angles = random.integers(-(2**31), 2**31, (300, 2)).tolist()
    pitches = random.uniform(-29.0, 29.0, (300, 2)).tolist()
    records = [(100 * n, *angles[n], *pitches[n]) for n in range(300)]
    experiment = logged_experiment(written(tmp_path / 'log.csv', records), {})
    fit = ExperimentFit(SegmentModel(cut(experiment)))
    fit.settle(experiment.plant)
    assert np.isfinite(fit.unknowns).all()
    assert len(fit.unknowns) == 14


def test_records_far_apart_are_refused(tmp_path):
    """Such as those whose time is in microseconds."""
    path = written(tmp_path / 'log.csv', [(100_000 * n, n, n, 0.0, 0.0) for n in range(9)])
    message = refusal(IdentificationError, logged_experiment, path, {})
    assert 'its records are 100000 ms apart; those of a brick are at most 1020 ms' in message


def test_the_slowest_log_has_segments_of_a_few_records(tmp_path):
    path = written(tmp_path / 'log.csv', [(1020 * n, n, n, 0.0, 0.0) for n in range(20)])
    segments = cut(logged_experiment(path, {}))
    assert (segments.count, segments.length) == (2, 8)
