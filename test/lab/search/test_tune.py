"""Tunings: their results, whatever the workers and interruptions."""

import os
import signal

import numpy as np
import pytest
from laws import refusal
from tried_searches import SHORT_PUSH, TUNING, Searching, files_in, write

from ballbot_ros import simulate
from ballbot_ros.errors import BallbotError, StudyError
from ballbot_ros.lab.search.optimiser import Method
from ballbot_ros.lab.search.tune import AFTER, BEFORE, SEARCH, STEPS, run_tuning
from ballbot_ros.lab.search.tuning import read_tuning
from ballbot_ros.lab.studies.execution import StudyStoppedError
from ballbot_ros.lab.studies.study_data import StudyData
from ballbot_ros.parameters import ControllerParameters
from ballbot_ros.parameters.files import read_parameter_file

K_F_2 = {'python': {'controller.k_f.2': {'uniform': [-3.0, -1.0]}}}


def tune(path, output, observer=None, *, again=False, **options):
    tuning = read_tuning(str(path), **options)
    return run_tuning(tuning, output, observer or Searching(), again=again)


@pytest.fixture(scope='module')
def finished(tmp_path_factory):
    folder = tmp_path_factory.mktemp('tune')
    observer = Searching()
    return tune(write(folder, TUNING), folder / 'results', observer), observer


def test_all_candidates_are_tried_on_the_same_robots(finished):
    result, _ = finished
    (folder,) = result.studies(SEARCH)
    table = StudyData.open(folder).table()
    # Two generations, and one or more with the steps around the best one.
    candidates = len(table) // 4
    assert candidates == 16 + 16
    masses = np.array(table['plant_sim.body_mass']).reshape(candidates, 4)
    assert (masses == masses[0]).all()
    assert len(set(masses[0])) == 4
    seeds = np.array(table['seed']).reshape(candidates, 4)
    assert (seeds == seeds[0]).all()
    gains = np.array(table['controller.k_f.2']).reshape(candidates, 4)
    assert (gains[:, 0] == gains.T).all()
    assert len(set(gains[:16, 0])) == 16
    assert gains[:16, 0].tolist() == [result.values(each)['controller.k_f.2'] for each in range(16)]


def test_the_verdicts_are_those_of_the_runs(finished):
    result, _ = finished
    table = StudyData.open(result.studies(SEARCH)[0]).table()
    values = np.array(table['peak_pitch_deg']) + 0.01 * np.array(table['duty_rms_percent'])
    fallen = np.array(table['fallen']).reshape(-1, 4).any(axis=1)
    means = values.reshape(-1, 4).mean(axis=1)
    of = result.verdicts
    np.testing.assert_allclose(of.value[~fallen[:16]], means[:16][~fallen[:16]])
    assert (of.is_feasible == ~fallen[:16]).all()
    assert result.best == int(np.argmin(np.where(fallen[:16], np.inf, means[:16])))
    assert result.around.shape == (2, len(STEPS))
    assert of.cost[result.best] <= of.cost[0]


def test_the_result_is_judged_on_robots_that_it_has_not_seen(finished):
    result, _ = finished
    seen = set(StudyData.open(result.studies(SEARCH)[0]).table()['seed'].to_pylist())
    before, after = (StudyData.open(result.studies(each)[0]).table() for each in (BEFORE, AFTER))
    assert len(before) == len(after) == 8
    assert before['seed'].equals(after['seed'])
    assert seen.isdisjoint(before['seed'].to_pylist())
    unseen = result.unseen()
    values = np.array(after['peak_pitch_deg']) + 0.01 * np.array(after['duty_rms_percent'])
    assert unseen.value[1] == pytest.approx(values.mean())


def test_the_parameter_file_is_for_runs(finished, tmp_path):
    result, _ = finished
    path = result.parameter_file
    assert path.read_text().startswith('# ballbot tune tried: objective ')
    written = {name: value for _, name, value in read_parameter_file(path)}
    k_f = written['k_f']
    filters = result.tuning.studies[0].spec.parameters.of(ControllerParameters)
    for name in ('a_d', 'a_r', 'a_gd'):  # gains are of use only with them
        assert written[name] == getattr(filters, name)
    best = result.values(result.best)
    assert (k_f[1], k_f[3]) == (best['controller.k_f.2'], best['controller.k_f.4'])
    nominal = simulate(write(tmp_path, TUNING).with_name('short_push.yaml'))
    tuned = simulate(tmp_path / 'short_push.yaml', parameters=path)
    assert tuned.duty_sha256 != nominal.duty_sha256
    again = tune(write(tmp_path, TUNING), tmp_path / 'again', parameter_file=path, candidates=8)
    start = again.values(0)
    assert start == pytest.approx(best)


def test_progress_shows_generation_best_value_and_spread(finished):
    _, observer = finished
    assert observer.begun == [32 * 4, 8, 8]
    assert observer.generations[1].startswith('generation 2/2  best ')
    assert ' ± ' in observer.generations[1]
    assert observer.generations[2:] == [
        f'{which}, on 8 robots not seen before' for which in (BEFORE, AFTER)
    ]


def same(result, expected):
    assert result.parameter_file.read_bytes() == expected.parameter_file.read_bytes()
    assert files_in(result.folder) == files_in(expected.folder)
    assert result.verdicts.cost.tolist() == expected.verdicts.cost.tolist()
    return True


def test_the_result_depends_neither_on_workers_nor_on_interruptions(
    finished, tmp_path, monkeypatch
):
    path, expected = write(tmp_path, TUNING), finished[0]
    for number, cores in (('four', {0, 1, 2, 3}), ('one', {0})):
        monkeypatch.setattr(os, 'sched_getaffinity', lambda pid, cores=cores: cores)
        assert same(tune(path, tmp_path / number), expected)

    output, known = tmp_path / 'stopped', 0
    for stop in (signal.SIGTERM, signal.SIGINT, signal.SIGHUP):
        with pytest.raises(StudyStoppedError) as stopped:
            tune(path, output, Searching(each=lambda stop=stop: os.kill(os.getpid(), stop)))
        assert stopped.value.signal == stop
        assert known < len(files_in(output)) < len(files_in(expected.folder))
        known = len(files_in(output))
        assert not (output / expected.parameter_file.name).exists()
    with pytest.raises(KeyboardInterrupt):
        tune(path, output, Searching(after=lambda: signal.raise_signal(signal.SIGINT)))
    assert same(tune(path, output), expected)
    # A finished one does no runs, unless asked to.
    for again, runs in ((False, 0), (True, 32 * 4 + 2 * 8)):
        observer = Searching()
        assert same(tune(path, output, observer, again=again), expected)
        assert observer.advanced == runs


def test_damaged_parts_are_done_again(finished, tmp_path):
    path, output = write(tmp_path, TUNING), tmp_path / 'results'
    tune(path, output)
    one, other, *_ = sorted((output / SEARCH / 'parts').iterdir())
    one.unlink()
    other.write_bytes(b'nothing')
    observer = Searching()
    result = tune(path, output, observer)
    assert result.parameter_file.read_bytes() == finished[0].parameter_file.read_bytes()
    assert [other.name in each for each in observer.notices] == [True]
    assert observer.advanced == 2 * StudyData.open(output / SEARCH).study.runs_per_part


def test_another_tuning_in_the_folder_is_refused(finished, tmp_path):
    folder = finished[0].folder
    for changes, options in (
        ({'seed': 3}, {}),
        ({'objective': {'sum': {'peak_pitch_deg': 2.0}}}, {}),
        ({'tune': K_F_2}, {}),
        ({}, {'candidates': 100}),
        ({}, {'method': Method.RANDOM}),
    ):
        path = write(tmp_path, TUNING, **changes)
        message = refusal(StudyError, lambda p=path, o=options: tune(p, folder, **o))
        assert str(folder) in message


def test_one_parameter_and_words_can_be_tuned_on_several_scenarios(tmp_path):
    """The scenarios may have expectations and properties of their own."""
    path = write(tmp_path, TUNING)
    other = {**SHORT_PUSH, 'expectations': {'peak_pitch_deg': {'max': 9, 'from': 1.0}}}
    write(tmp_path, TUNING, {**other, 'properties': {'low': 'always: abs(pitch_x_deg) < 5'}})
    path.with_name('short_push.yaml').rename(tmp_path / 'other.yaml')
    path = write(
        tmp_path, TUNING, scenario=['short_push.yaml', 'other.yaml'], candidates=4, population=2,
        tune={'python': {
            **K_F_2['python'],
            'controller.mode': {'list': ['remote', 'autonomous'], 'start': 'autonomous'},
        }},
        objective={'over': 'worst', 'sum': {'peak_pitch_deg': 1.0}},
        limits={'dead_time_margin_ms': {'min': 1.0}, 'duty_rms_percent': {'max': 90}},
    )  # fmt: skip
    result = tune(path, tmp_path / 'results')
    assert [each.name for each in result.studies(SEARCH)] == ['short_push', 'other']
    assert result.values(0)['controller.mode'] == 'autonomous'
    assert result.verdicts.limits.shape == (4, 2)
    worst = [
        np.array(StudyData.open(each).table()['peak_pitch_deg']).reshape(-1, 4)[:4].max(axis=1)
        for each in result.studies(SEARCH)
    ]
    assert result.verdicts.value.tolist() == np.max(worst, axis=0).tolist()
    assert result.unseen().limits.shape == (2, 2)


def test_a_property_can_be_tuned_of_another_controller(tmp_path):
    path = write(
        tmp_path, TUNING, candidates=8, runs=2, unseen=2,
        tune={'pid': {'controller.user.pitch_p': {'log_uniform': [0.5, 5.0]}}},
        properties={'upright': 'always: abs(pitch_x_deg) < 5'},
        objective={'over': 0.9, 'sum': {'upright': 1.0}},
    )  # fmt: skip
    result = tune(path, tmp_path / 'results')
    table = StudyData.open(result.studies(SEARCH)[0]).table()
    worst = -np.array(table['upright']).reshape(-1, 2)[:8].min(axis=1)
    known = ~np.isnan(result.verdicts.value)
    assert known.any()
    assert result.verdicts.value[known].tolist() == worst[known].tolist()
    text = result.parameter_file.read_text()
    assert 'implementation: pid' in text
    assert 'user.pitch_p' in text


def test_what_has_no_value_is_told_in_one_line(tmp_path):
    for changes in (
        {
            'objective': {'sum': {'later': 1.0}},
            'properties': {'later': 'from 3 s: pitch_x_deg < 5'},
        },
        {'tune': {'python': {'controller.k_f.2': {'uniform': [1e8, 1e9], 'start': 5e8}}}},
    ):
        path = write(tmp_path, TUNING, **changes)
        output = tmp_path / str(len(list(tmp_path.iterdir())))
        message = refusal(BallbotError, tune, path, output)
        assert message == (
            'tried: the objective has no value in any run of the first 8 candidates: all robots '
            'fall, or a measure has no value'
        )


def test_folders_that_cannot_have_it_are_told_in_one_line(tmp_path):
    path = write(tmp_path, TUNING)
    (tmp_path / 'file').write_text('')
    (tmp_path / 'foreign').mkdir()
    (tmp_path / 'foreign' / SEARCH).mkdir()
    (tmp_path / 'foreign' / SEARCH / 'mine.txt').write_text('')
    for output, told in (
        (tmp_path / 'file', 'not a folder'),
        (tmp_path / 'foreign', 'has files, but no manifest.json'),
    ):
        assert told in refusal(BallbotError, tune, path, output)
