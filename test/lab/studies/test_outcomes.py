"""How runs ended by the words that vary, and studies of several scenarios and controllers."""

import json

import pytest
import yaml
from laws import refusal
from study_folders import record, write_study

from ballbot_ros.lab.studies.from_python import study as study_from_python
from ballbot_ros.lab.studies.outcomes import Ending, ending_table, endings_of
from ballbot_ros.lab.studies.reader import read_studies, read_study
from ballbot_ros.lab.studies.study_data import StudyData

SEVERAL = {
    'purpose': 'x',
    'scenario': ['push', 'hardware_autonomous'],
    'controller': ['python', 'pid'],
    'profile': 'hardware',
    'parameters': {'plant_sim': {'duration': 5.0}},
    'faults': [{'component': 'sonar', 'type': 'stuck', 'time': 1.5}],
    'sampling': 'grid',
    'vary': {'fault.1.kind': {'list': ['motor_x off', 'gamepad off']}},
    'expectations': {'peak_pitch_deg': {'max': 10.0}},
}
WORDS = ('python', 'pid')


@pytest.fixture(scope='module')
def path(tmp_path_factory):
    path = tmp_path_factory.mktemp('several') / 'mine.yaml'
    path.write_text(yaml.safe_dump(SEVERAL), encoding='utf-8')
    return path


@pytest.fixture(scope='module')
def results(path):
    folder = path.with_name('results')
    study_from_python(path, output=folder)
    return folder


@pytest.mark.parametrize('has_walls', [False, True])
def test_endings_are_those_of_the_rows(tmp_path, has_walls):
    parameters = f'plant_sim: {{map: {"track" if has_walls else repr("")}, seed: 1}}\n'
    write_study(tmp_path / 'study', record(parameters=parameters))
    data = StudyData.open(tmp_path / 'study')
    frame = data.frame()
    endings = endings_of(data)
    model = frame['plant_sim.model']
    assert [each.words['plant_sim.model'] for each in endings] == model.unique().tolist()
    for each in endings:
        rows = frame[model == each.words['plant_sim.model']]
        failed = rows['outcome'] == 'failed'
        fallen = rows['fallen'] & ~failed
        assert each[1:4] == (len(rows), failed.sum(), fallen.sum())
        bad = rows[failed] if failed.any() else rows[fallen] if fallen.any() else rows
        assert each.worst == bad['number'][bad['peak_pitch_deg'].idxmax()]
        word = 'hit a wall' if has_walls else 'failed'
        assert (f'{word} {failed.sum()} of {len(rows)}' in each.text) == failed.any()
        assert (f'fell {fallen.sum()} of {len(rows)}' in each.text) == fallen.any()


def test_a_table_says_what_is_not_possible():
    cases = [
        ('gyro_x off', 'pid', 'push'),
        ('tick slow', 'pid', 'push'),
        ('gyro_x off', 'lqg', 'square'),
    ]
    names = 'fault.1.kind', 'controller', 'scenario'
    endings = [
        Ending(dict(zip(names, words, strict=True)), 2, 0, 0, number, 'survived')
        for number, words in enumerate(cases)
    ]
    none = 'not possible'
    assert ending_table(endings) == [
        ['fault.1.kind', 'controller', 'push', 'square'],
        ['gyro_x off', 'pid', 'survived (0)', none],
        ['gyro_x off', 'lqg', none, 'survived (2)'],
        ['tick slow', 'pid', 'survived (1)', none],
        ['tick slow', 'lqg', none, none],
    ]


def test_each_scenario_and_controller_has_a_study(path):
    studies = list(read_studies(str(path)))
    cases = [(each, word) for each in SEVERAL['scenario'] for word in WORDS]
    assert [tuple(each.case.values()) for each in studies] == cases
    assert [each.name for each in studies] == [f'mine_{each}_{word}' for each, word in cases]
    assert read_study(str(path)).case == studies[0].case
    own = list(read_studies(str(path), controller='lqg'))
    assert [tuple(each.case.values()) for each in own] == [(s, 'lqg') for s in SEVERAL['scenario']]


def test_results_of_several_are_one_frame(path, results):
    frame = study_from_python(path, output=results)
    assert len(frame) == 8
    assert frame.groupby(['scenario', 'controller'])['number'].count().tolist() == [2] * 4
    alone = StudyData.open(results / 'push/pid').frame()
    rows = frame[(frame['scenario'] == 'push') & (frame['controller'] == 'pid')]
    assert rows['duty_sha256'].tolist() == alone['duty_sha256'].tolist()


def test_the_command_prints_a_table_of_several(command, path, results):
    status, text, error = command('study', path, '--output', results)
    assert status == 0, error
    lines = [line.split('│')[1:-1] for line in text.splitlines() if line.startswith('│')]
    cells = {tuple(each.strip() for each in line[:2]): line[2:] for line in lines}
    for word in WORDS:
        for each in cells['motor_x off', word]:
            assert each.strip() == 'fell 1 of 1 (0)'
        for each in cells['gamepad off', word]:
            assert each.strip() == 'survived (1)'
    assert f'study rerun {results}/SCENARIO/CONTROLLER NUMBER' in text


def test_a_worst_run_comes_back_from_its_own_folder(command, path, results):
    status, text, _ = command('study', path, '--output', results, '--json')
    worst = [each for each in json.loads(text)['outcomes'] if each['fallen']]
    assert status == 0
    assert len(worst) == 4
    case = worst[-1]
    folder = results / case['words']['scenario'] / case['words']['controller']
    words = 'rerun', folder, case['worst'], '--processes', 'none'
    status, text, _ = command('study', *words, '--output', path.with_name('again'))
    assert 'duties  as in the study: ' in text


def test_the_report_of_several_is_their_table(command, path, results):
    page = path.with_name('page')
    assert command('study', 'report', results, '--output', page)[0] == 0
    html = (page / 'index.html').read_text(encoding='utf-8')
    assert html.count('fell 1 of 1 (0)') == 4
    assert 'SCENARIO/CONTROLLER NUMBER' in html
    assert command('study', 'report', results / 'push/pid', '--output', page)[0] == 0
    assert 'fell 1 of 1 (0)' in (page / 'index.html').read_text(encoding='utf-8')


def test_a_folder_without_studies_has_no_report(command, tmp_path):
    status, _, error = command('study', 'report', tmp_path)
    assert status == 2
    assert 'not the folder of a study' in error


def test_a_wrong_controller_of_several_is_refused(path, tmp_path):
    own = tmp_path / 'own.yaml'
    own.write_text(yaml.safe_dump({**SEVERAL, 'controller': ['pid', 'pidd']}), encoding='utf-8')
    told = refusal(Exception, lambda: list(read_studies(str(own))))
    assert 'pidd' in told
    assert f'{own}:' in told
