"""Falsifications: what they find, whatever the workers and interruptions, and what it is."""

import os
import shutil
import signal

import numpy as np
import pytest
from laws import refusal
from own_controllers import BALANCE
from tried_searches import SHORT_PUSH, STUDY, Searching, files_in, write

from ballbot_ros import simulate
from ballbot_ros.errors import BallbotError, StudyError
from ballbot_ros.lab.search import falsify
from ballbot_ros.lab.search.falsify import (
    COMPLETED,
    POPULATION,
    Falsification,
    check,
    robustness,
    run_falsification,
)
from ballbot_ros.lab.search.optimiser import Method
from ballbot_ros.lab.studies.columns import MeasureColumn
from ballbot_ros.lab.studies.execution import StudyStoppedError
from ballbot_ros.lab.studies.reader import read_study
from ballbot_ros.lockstep.run_actions import Outcome
from ballbot_ros.run.execution import execute
from ballbot_ros.run.requirements import Processes
from ballbot_ros.run.result import RunResult
from ballbot_ros.run.spec import RunOptions, RunSpec


def search(path, output, observer=None, *, wanted=2, method=Method.CMA, again=False, **options):
    study = read_study(str(path), **options)
    check(study)
    return run_falsification(
        Falsification(study, wanted, method),
        output,
        observer or Searching(),
        processes=Processes.NONE,
        again=again,
    )


@pytest.fixture(scope='module')
def finished(tmp_path_factory):
    folder = tmp_path_factory.mktemp('falsify')
    observer = Searching()
    return search(write(folder, STUDY), folder / 'results', observer), observer


def told(result):
    """What a falsification has found, but for the folder."""
    found = [
        (each.number, each.requirement, each.found, each.shrunk, each.seed, each.duty_sha256)
        for each in result.counterexamples
    ]
    return result.runs, result.violating, result.least, found


def test_each_counterexample_is_a_scenario_that_violates_the_requirement(finished, tmp_path):
    result, _ = finished
    assert len(result.counterexamples) == 2
    assert result.violating >= 2
    assert set(result.least) == {'peak_position_m', 'upright'}
    assert min(result.least.values()) < 0.0
    for each in result.counterexamples:
        assert each.is_same
        assert each.scenario.with_suffix('.mcap').exists()
        # The file alone has all of it.
        options = RunOptions(processes=Processes.NONE, record=False)
        run = execute(RunSpec.of_scenario(shutil.copy(each.scenario, tmp_path), options))
        assert run.duty_sha256 == each.duty_sha256
        assert set(each.deviations) <= set(each.found)
        assert [name for name in each.found if each.found[name] != each.shrunk[name]]
        held = {judged.expectation.metric: judged.holds for judged in run.judgements}
        held |= {judged.of.name: judged.holds for judged in run.properties}
        assert not held[each.requirement]


def test_progress_and_budget(finished):
    result, observer = finished
    assert observer.runs == 48
    assert result.runs % POPULATION == 0
    searched = [each for each in observer.generations if each.startswith('lowest')]
    assert len(searched) == result.runs // POPULATION
    assert searched[-1].endswith('2 found')


def test_the_result_depends_neither_on_workers_nor_on_interruptions(
    finished, tmp_path, monkeypatch
):
    path, expected = write(tmp_path, STUDY), finished[0]
    for number, cores in (('four', {0, 1, 2, 3}), ('one', {0})):
        monkeypatch.setattr(os, 'sched_getaffinity', lambda pid, cores=cores: cores)
        assert told(search(path, tmp_path / number)) == told(expected)
        assert files_in(tmp_path / number) == files_in(expected.folder)

    output, parts = tmp_path / 'stopped', iter((signal.SIGTERM, signal.SIGINT))
    for stop in parts:
        with pytest.raises(StudyStoppedError) as stopped:
            search(path, output, Searching(each=lambda stop=stop: os.kill(os.getpid(), stop)))
        assert stopped.value.signal == stop
    assert 0 < len(files_in(output)) < len(files_in(expected.folder))
    interrupting = Searching(after=lambda: signal.raise_signal(signal.SIGINT))
    with pytest.raises(KeyboardInterrupt):
        search(path, output, interrupting)
    assert told(search(path, output)) == told(expected)
    assert files_in(output) == files_in(expected.folder)
    # Once more it does no run of the search, unless asked to.
    observer = Searching()
    assert told(search(path, output, observer)) == told(expected)
    assert observer.advanced == 0
    observer = Searching()
    assert told(search(path, output, observer, again=True)) == told(expected)
    assert observer.advanced == expected.runs


def test_what_was_found_in_a_smaller_budget_remains(finished, tmp_path):
    """The search ends after the wanted number, or with its budget."""
    path = write(tmp_path, STUDY)
    first = search(path, tmp_path / 'first', wanted=1)
    assert told(first)[3] == told(finished[0])[3][:1]
    few = search(path, tmp_path / 'few', runs=5, method=Method.RANDOM)
    assert few.runs == 5
    more = search(path, tmp_path / 'first', wanted=2)
    assert told(more) == told(finished[0])


def test_another_search_in_the_folder_is_refused(finished, tmp_path):
    folder = finished[0].folder
    for changes, options in (
        ({'seed': 3}, {}),
        ({'vary': {'push.1.force': {'uniform': [0.5, 4.5]}}}, {}),
        ({}, {'method': Method.RANDOM}),
        ({}, {'runs': 40}),
    ):
        path = write(tmp_path, STUDY, **changes)
        message = refusal(StudyError, lambda p=path, o=options: search(p, folder, **o))
        assert str(folder) in message


def test_random_search_is_repeatable_too(tmp_path):
    path = write(tmp_path, STUDY)
    one, other = (
        search(path, tmp_path / name, wanted=1, method=Method.RANDOM) for name in ('one', 'other')
    )
    assert told(one) == told(other)


def test_a_wall_hit_is_a_counterexample_though_nothing_forbids_it(tmp_path):
    scenario = {**SHORT_PUSH, 'map': 'corridor', 'start': {'position_x': 0.5}}
    vary = {
        'push.1.force': {'uniform': [1.0, 4.0]},
        'plant_sim.start_position_x': {'uniform': [1.0, 1.3]},
    }
    path = write(
        tmp_path, {**STUDY, 'expectations': {'peak_pitch_deg': {'max': 80}}, 'properties': {}},
        scenario, vary=vary,
    )  # fmt: skip
    (found,) = search(path, tmp_path / 'results', wanted=1).counterexamples
    assert (found.requirement, found.is_same) == (COMPLETED, True)
    run = simulate(found.scenario)
    assert (run.verdict, run.duty_sha256) == ('failed', found.duty_sha256)


def test_levels_without_the_nominal_value_and_faults_can_be_searched(tmp_path):
    scenario = {
        **SHORT_PUSH,
        'faults': [{'component': 'gyro_x', 'type': 'stuck', 'time': 1.5}],
    }
    vary = {
        'plant_sim.body_mass': {'list': [0.6, 0.9]},
        'push.1.direction': {'list': [170.0, 190.0]},
        'fault.1.kind': {'list': ['gyro_y stuck', 'encoder_x stuck']},
        'fault.1.time': {'uniform': [1.0, 2.0]},
        'plant_sim.seed': {'uniform': [0, 1000]},
    }
    expectations = {'peak_pitch_deg': {'max': 3}}
    path = write(tmp_path, STUDY, scenario, vary=vary, expectations=expectations)
    (found,) = search(path, tmp_path / 'results', wanted=1).counterexamples
    assert found.is_same
    assert simulate(found.scenario).duty_sha256 == found.duty_sha256


def test_the_end_of_the_run_can_be_earlier_than_the_scenarios(tmp_path):
    late = {'time': 2.2, 'duration': 0.1, 'force': 1.0, 'direction': 'left'}
    scenario = {**SHORT_PUSH, 'pushes': [*SHORT_PUSH['pushes'], late]}
    path = write(tmp_path, STUDY, scenario, parameters={'plant_sim': {'duration': 2.0}})
    (found,) = search(path, tmp_path / 'results', wanted=1).counterexamples
    assert found.is_same
    assert simulate(found.scenario).duty_sha256 == found.duty_sha256


def test_a_property_that_a_run_leaves_undecided_is_named(tmp_path):
    """Not passed is all that the results say; no other requirement must get the blame."""
    properties = {
        'early': 'after push 1: always: abs(pitch_x_deg) < 80',
        'settles': 'after push 1: eventually within 0.5 s: abs(pitch_x_deg) < 80',
    }
    path = write(
        tmp_path, {**STUDY, 'expectations': {}}, properties=properties,
        vary={'push.1.time': {'uniform': [1.2, 2.3]}},
    )  # fmt: skip
    (found,) = search(path, tmp_path / 'results', wanted=1, runs=200).counterexamples
    assert found.requirement == 'settles'
    assert found.shrunk['push.1.time'] > 1.8


def test_a_controller_of_the_users_file_is_in_the_scenario(tmp_path):
    (tmp_path / 'own.py').write_text(BALANCE, encoding='utf-8')
    path = write(
        tmp_path, STUDY, controller='own.py:Balance', runs=1, properties={},
        expectations={'peak_pitch_deg': {'max': 0.1}}, vary={'push.1.force': {'list': [1.0]}},
    )  # fmt: skip
    (found,) = search(path, tmp_path / 'results', wanted=1).counterexamples
    assert found.is_same
    assert f'{tmp_path / "own.py"}:Balance' in found.scenario.read_text()


def test_a_stop_while_it_records_is_one_of_the_search(finished, tmp_path, monkeypatch):
    folder = shutil.copytree(finished[0].folder, tmp_path / 'results')
    stopped = RunResult(Outcome.STOPPED, failure_status=128 + signal.SIGTERM)
    monkeypatch.setattr(falsify, 'execute', lambda spec: stopped)
    with pytest.raises(StudyStoppedError) as error:
        search(write(tmp_path, STUDY), folder)
    assert error.value.signal == signal.SIGTERM


MISTAKES = [
    ({'vary': {}}, 'tried: nothing varies but the seed; there is nothing to search'),
    ({'properties': {}, 'expectations': {}}, 'has neither properties nor expectations'),
    ({'redesign': 'lqr'}, 'a search needs the same gains in all runs: omit redesign'),
    ({'runs': 1_000_001}, '1,000,001 runs; at most 1,000,000 are searched'),
    (
        {'properties': {'some': 'always: duty_x_percent <= 100'}},
        "tried: 'some': nothing can violate it, whatever the signals: always: duty_x_",
    ),
    (
        {'properties': {'some': 'from 3 s: always: duty_x_percent <= 50'}, 'expectations': {}},
        f"tried: 'some' has no value in any of the first {POPULATION} runs",
    ),
    (
        {
            'properties': {'some': 'always: abs(pitch_y_deg) < 6'}, 'expectations': {},
            'vary': {'push.1.force': {'uniform': [0.5, 1.0]}},
        },
        f"'some': it is 6 ° from a violation in all of the first {POPULATION} runs: nothing that",
    ),
]  # fmt: skip


@pytest.mark.parametrize(('changes', 'text'), MISTAKES)
def test_what_cannot_be_searched_is_told_in_one_line(tmp_path, changes, text):
    path = write(tmp_path, STUDY, **changes)
    assert text in refusal(BallbotError, search, path, tmp_path / 'results')


def test_a_requirement_that_nothing_changes_is_not_searched(tmp_path):
    observer = Searching()
    properties = {'some': 'always: abs(pitch_y_deg) < 6', 'x': 'always: abs(pitch_x_deg) < 6'}
    vary = {'push.1.force': {'uniform': [0.0, 0.1]}}
    path = write(tmp_path, STUDY, properties=properties, expectations={}, vary=vary, runs=40)
    result = search(path, tmp_path / 'results', observer)
    assert result.runs == 40
    (notice,) = [each for each in observer.notices if 'is not searched' in each]
    assert notice.startswith("'some' is not searched: it is 6 ° from a violation")


def test_robustness_is_the_distance_within_the_bounds():
    values = np.array([-1.0, 2.0, 5.0, np.nan])
    for low, high, expected in (
        (None, 4.0, [5.0, 2.0, -1.0, np.nan]),
        (0.0, None, [-1.0, 2.0, 5.0, np.nan]),
        (0.0, 4.0, [-1.0, 2.0, -1.0, np.nan]),
    ):
        column = MeasureColumn('x', minimum=low, maximum=high)
        assert np.array_equal(robustness(column, values), expected, equal_nan=True)
