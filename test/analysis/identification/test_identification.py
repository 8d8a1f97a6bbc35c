"""What is identified: which parameters, from which parts of a run, and how well."""

from dataclasses import replace

import numpy as np
import pytest
from laws import refusal

import ballbot_ros as bb
from ballbot_ros.analysis.data_log import read_data_log, write_data_log
from ballbot_ros.analysis.identification.estimation import ExperimentFit
from ballbot_ros.analysis.identification.experiment import (
    ENCODER,
    GYRO,
    logged_experiment,
    recorded_experiment,
)
from ballbot_ros.analysis.identification.identification import (
    CANDIDATES,
    HARD_TO_MEASURE,
    MAX_HALF_WIDTH,
    MAX_INFLATION,
    Identifiability,
    check_names,
    choose,
    identify,
)
from ballbot_ros.analysis.identification.segment_model import SegmentModel
from ballbot_ros.analysis.identification.segments import cut
from ballbot_ros.analysis.run_data import read_run
from ballbot_ros.errors import IdentificationError
from ballbot_ros.parameters import PlantParameters
from ballbot_ros.recording.csv_log import HEADER
from ballbot_ros.recording.messages.topics import GYRO_IMU, MOTOR_DUTY
from ballbot_ros.recording.reader import RecordingReader

DOCUMENT = PlantParameters()
NARROW = 1e4
"""Information of an interval of 2 %."""


def correlated(correlation, information=NARROW):
    return information * np.array([[1.0, correlation], [correlation, 1.0]])


def test_independent_parameters_are_all_told_apart():
    names = 'body_mass', 'dead_zone', 'gravity'
    assert choose(np.diag([NARROW, 3.0 * NARROW, 1e9]), names) == names


@pytest.mark.parametrize('sign', [1.0, -1.0])
def test_of_two_that_act_alike_the_first_is_taken(sign):
    for names in ('body_mass', 'gravity'), ('gravity', 'body_mass'):
        assert choose(correlated(sign), names) == names[:1]
        assert choose(correlated(sign * 0.99999, 1e12), names) == names[:1]


def test_two_are_told_apart_up_to_the_largest_inflation():
    names = 'body_mass', 'gravity'
    for inflation, count in ((0.95 * MAX_INFLATION, 2), (1.05 * MAX_INFLATION, 1)):
        correlation = np.sqrt(1.0 - inflation**-2)
        assert len(choose(correlated(correlation, 1e9), names)) == count, inflation


def test_what_is_not_seen_is_not_taken_and_harms_no_other():
    names = 'body_mass', 'dead_zone', 'gravity'
    for little in (0.0, 100.0):
        for number in range(3):
            information = np.full(3, NARROW)
            information[number] = little
            others = tuple(name for name in names if name != names[number])
            assert choose(np.diag(information), names) == others, (little, number)


def test_a_parameter_must_not_widen_those_before_it_too_much():
    """The interval of the first is narrow as long as the second is not an unknown, too."""
    names = 'body_mass', 'gravity'
    assert choose(correlated(0.98, 1e3), names) == names[:1]


def test_a_sum_of_two_comes_after_them():
    """The third acts as the first two together: any two of them are told apart."""
    basis = np.array([[1.0, 0.0, 1.0], [0.0, 1.0, 1.0]])
    information = NARROW * basis.T @ basis
    for order in ([0, 1, 2], [2, 0, 1], [1, 2, 0]):
        names = [('body_mass', 'dead_zone', 'gravity')[number] for number in order]
        assert choose(information[np.ix_(order, order)], names) == tuple(names[:2])


@pytest.mark.parametrize(
    ('names', 'message'),
    [
        (['body_mas'], "'body_mas' cannot be identified; did you mean body_mass?"),
        (['body_mass', 'backlash'], "'backlash' cannot be identified; "),
        (['gravity', 'body_mass', 'gravity'], 'gravity is given twice'),
    ],
)
def test_a_wrong_name_ends_with_one_line(names, message):
    assert message in refusal(IdentificationError, check_names, names)
    assert message in refusal(IdentificationError, identify, [], names)


def test_an_unknown_name_is_answered_with_those_that_can_be_identified():
    message = refusal(IdentificationError, check_names, ['xyz'])
    assert all(name in message for name in CANDIDATES)


def test_all_candidates_can_be_asked_for():
    check_names(CANDIDATES)
    assert set(HARD_TO_MEASURE) < set(CANDIDATES)


def simulated(folder, scenario='excitation', duration=16.0, **plant):
    """Return the recorded run of a robot with changed parameters."""
    values = {'duration': duration, **plant}
    parameters = {f'plant_sim.{name}': value for name, value in values.items()}
    return read_run(bb.simulate(scenario, parameters=parameters).save(folder / f'{scenario}.mcap'))


@pytest.fixture(scope='module')
def heavy(tmp_path_factory):
    """Return a run of the linear model, which is quick to fit."""
    mass = 1.05 * DOCUMENT.body_mass
    return simulated(tmp_path_factory.mktemp('heavy'), body_mass=mass, plant_model='linear')


@pytest.mark.slow
def test_the_truth_tells_the_exact_parameters(tmp_path):
    height, torque = 1.04 * DOCUMENT.body_height, 0.97 * DOCUMENT.torque_constant
    run = simulated(tmp_path, duration=10.0, body_height=height, torque_constant=torque)
    found = identify([recorded_experiment(run, {}, truth=True)], ('body_height', 'torque_constant'))
    for row, true in zip(found.parameters, (height, torque), strict=True):
        assert row.verdict is Identifiability.IDENTIFIED
        assert row.value == pytest.approx(true, rel=1e-4)
        assert row.relative < 1e-3
        assert row.recorded == true
    (summary,) = found.experiments
    assert summary.dropped == 0
    for channel, before in summary.before.items():
        assert summary.after[channel] < 0.01 * before


def assert_mass_is_found(found, true):
    row = found.parameters[0]
    assert (row.name, row.verdict, row.recorded) == ('body_mass', Identifiability.IDENTIFIED, true)
    assert row.start == DOCUMENT.body_mass
    assert abs(row.value - true) <= 1.5 * row.half_width
    assert row.relative < MAX_HALF_WIDTH
    assert row.half_width == pytest.approx(row.relative * row.value)


def identify_mass_and_friction(run):
    return identify([recorded_experiment(run, {})], ('body_mass', 'motor_friction'))


@pytest.fixture(scope='module')
def found_heavy(heavy):
    return identify_mass_and_friction(heavy)


def test_the_devices_of_a_brick_tell_parameters_within_their_intervals(heavy, found_heavy):
    """Those of the nonlinear model: test/benchmark/test_identification.py."""
    assert_mass_is_found(found_heavy, heavy.plant.body_mass)
    assert found_heavy.correlation.shape == (2, 2)
    np.testing.assert_allclose(np.diag(found_heavy.correlation), 1.0)
    friction = found_heavy.parameters[1]
    assert abs(friction.value - DOCUMENT.motor_friction) <= 1.5 * friction.half_width


def test_the_same_run_gives_the_same_result(heavy, found_heavy):
    second = identify_mass_and_friction(heavy)
    assert found_heavy.parameters == second.parameters
    assert found_heavy.experiments == second.experiments
    np.testing.assert_array_equal(found_heavy.correlation, second.correlation)


def test_a_robot_that_stands_tells_nothing(tmp_path):
    run = simulated(tmp_path, 'hardware_standing', 4.0)
    found = identify([recorded_experiment(run, {})])
    assert [row.name for row in found.parameters] == list(HARD_TO_MEASURE)
    assert {row.verdict for row in found.parameters} == {Identifiability.NOT_SEEN}
    assert found.estimated == ()
    assert all(row.start == row.recorded for row in found.parameters)
    (summary,) = found.experiments
    assert 'in which the robot balances undisturbed and both encoders turn' in summary.notes[-1]


def without(run, topic, dropped=slice(None)):
    """Return a run without some samples of a topic, or without the topic."""
    series = dict(run.series)
    old = series.pop(topic)
    if dropped != slice(None):
        parts = (np.delete(each, dropped, axis=0) for each in (old.stamps, old.time, old.values))
        series[topic] = type(old)(*parts)
    return replace(run, series=series)


def test_a_recording_without_the_gyro_is_refused(heavy):
    message = refusal(IdentificationError, recorded_experiment, without(heavy, GYRO_IMU), {})
    assert message == f'{heavy.path}: topic {GYRO_IMU.name!r} was not recorded'
    assert recorded_experiment(without(heavy, GYRO_IMU), {}, truth=True).usable.any()


def test_a_free_running_run_is_refused(heavy):
    run = replace(heavy, plant=replace(heavy.plant, lockstep=False))
    assert 'record one in lockstep' in refusal(IdentificationError, recorded_experiment, run, {})


def test_no_segment_crosses_missing_ticks(heavy):
    first, count = 1500, 20
    whole = recorded_experiment(heavy, {})
    run = without(heavy, MOTOR_DUTY, slice(first, first + count))
    experiment = recorded_experiment(run, {})
    assert whole.notes == ()
    assert experiment.notes == (f'{count} missing ticks: no segment crosses a gap.',)
    missing = np.zeros(len(whole.usable), np.bool_)
    missing[first : first + count] = True
    np.testing.assert_array_equal(experiment.usable, whole.usable & ~missing)
    before, after = cut(whole), cut(experiment)
    assert ((after.starts + after.length <= first) | (after.starts >= first + count)).all()
    early = before.starts + before.length <= first
    np.testing.assert_array_equal(after.starts[: early.sum()], before.starts[early])
    assert (after.starts >= first + count).any()


def test_values_that_are_known_replace_those_of_the_run(heavy):
    experiment = recorded_experiment(heavy, {'backlash': 0.0, 'dead_zone': 3.0})
    assert (experiment.plant.backlash, experiment.plant.dead_zone) == (0.0, 3.0)
    assert experiment.recorded == heavy.plant


def test_segments_with_wrong_readings_are_dropped(heavy):
    """An encoder that shows a turn of 50 degrees to and fro, for half a second."""
    experiment = recorded_experiment(heavy, {})
    clean = cut(experiment)
    first = clean.starts[clean.count // 2]
    ramp = np.interp(np.arange(clean.length), [0, 62, clean.length - 1], [0.0, 50.0, 0.0])
    encoder = experiment.readings[ENCODER].copy()
    encoder[first : first + clean.length, 0] += np.rint(ramp)
    wrong = replace(experiment, readings={**experiment.readings, ENCODER: encoder})
    segments = cut(wrong)
    hit = (segments.starts < first + clean.length) & (segments.starts + segments.length > first)
    assert 1 <= hit.sum() <= 2

    fit = ExperimentFit(SegmentModel(segments))
    fit.settle(experiment.plant)
    fit.improve(experiment.plant, 0.0)
    np.testing.assert_array_equal(fit.model.segments.starts, segments.starts[~hit])

    found = identify([wrong], ('body_mass',))
    assert_mass_is_found(found, heavy.plant.body_mass)
    (summary,) = found.experiments
    assert summary.dropped == hit.sum()
    assert summary.segments == segments.count - hit.sum()


@pytest.mark.parametrize('wrong', [1e12, 1e200])
def test_readings_without_sense_harm_only_their_segments(heavy, wrong):
    """Also if their squares exceed all others by orders of magnitude, or are not finite."""
    experiment = recorded_experiment(heavy, {})
    segments = cut(experiment)
    hit = np.arange(segments.count) == segments.count // 2
    first = segments.starts[hit][0]
    gyro = experiment.readings[GYRO].copy()
    gyro[first + 50 : first + 60] = wrong
    fit = ExperimentFit(SegmentModel(cut(with_gyro(experiment, gyro))))
    fit.settle(experiment.plant)
    np.testing.assert_array_equal(fit.model.segments.starts, segments.starts[~hit])
    assert fit.dropped == 1

    untouched = ExperimentFit(SegmentModel(segments))
    untouched.settle(experiment.plant)
    np.testing.assert_allclose(fit.unknowns, untouched.unknowns[~hit], rtol=1e-3, atol=1e-4)


def test_of_readings_without_sense_nothing_is_seen(heavy):
    experiment = recorded_experiment(heavy, {})
    gyro = np.full_like(experiment.readings[GYRO], 1e200)
    found = identify([with_gyro(experiment, gyro)], ('body_mass',))
    assert [row.verdict for row in found.parameters] == [Identifiability.NOT_SEEN]


def test_some_experiments_with_duties_cannot_be_fitted_with_others_without(heavy):
    experiment = recorded_experiment(heavy, {})
    message = refusal(IdentificationError, identify, [experiment, replace(experiment, duty=None)])
    assert 'cannot be fitted together' in message


@pytest.mark.slow
def test_the_duties_in_a_data_log_tell_motor_and_dead_zone(tmp_path):
    names = 'back_emf_constant', 'dead_zone'
    true = {'back_emf_constant': 0.49, 'dead_zone': 5.0}
    values = {'plant_sim.plant_model': 'linear', 'plant_sim.duration': 12.0,
              'controller.log_count': 1, 'controller.log_content': 'duties_and_gyros',
              **{f'plant_sim.{name}': value for name, value in true.items()}}  # fmt: skip
    path = bb.simulate('excitation', parameters=values).save(tmp_path / 'run.mcap')
    with RecordingReader(path) as reader:
        (log,) = write_data_log(read_data_log(reader), tmp_path / 'log.csv')
    known = {'backlash': read_run(path).plant.backlash, 'link_phase': 0}  # that of the seed
    found = identify([logged_experiment(log, known)], names)
    for row in found.parameters:
        assert row.verdict is Identifiability.IDENTIFIED
        assert row.value == pytest.approx(true[row.name], abs=1.5 * row.half_width)
        assert row.relative < 0.05
    cells = [line.split(',') for line in log.read_text().splitlines()[1:]]
    pitch_only = '\n'.join(','.join([time, '0', '0', *rest]) for time, _, _, *rest in cells)
    log.write_text(f'{HEADER}\n{pitch_only}\n')
    found = identify([logged_experiment(log, known)], names)
    assert {row.verdict for row in found.parameters} == {Identifiability.NOT_SEEN}


def with_gyro(experiment, gyro):
    return replace(experiment, readings={**experiment.readings, GYRO: gyro})
