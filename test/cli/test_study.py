"""`ballbot study`: run, list, rerun, and its mistakes."""

import json
import shutil
import subprocess

import pytest
import yaml
from graph import BALLBOT, LAST_RESORT_S, call, environment

CONTENT = {
    'purpose': 'a test',
    'runs': 40,
    'vary': {
        'plant_sim.body_mass': {'uniform': [0.6, 0.75]},
        'controller.k_f.2': {'uniform': [-1.7, -1.5]},
        'push.1.force': {'uniform': [0.5, 3.0]},
        'push.1.direction': {'uniform': [-180.0, 180.0]},
    },
    'expectations': {'peak_pitch_deg': {'max': 5.0}},
}

SHORT_PUSH = {
    'purpose': 'a test',
    'duration': 3.0,
    'profile': 'ideal',
    'pushes': [{'time': 1.5, 'duration': 0.1, 'force': 1.0, 'direction': 'forward'}],
}


@pytest.fixture(scope='module')
def study(tmp_path_factory):
    folder = tmp_path_factory.mktemp('study')
    scenario, path = folder / 'short_push.yaml', folder / 'tried.yaml'
    scenario.write_text(yaml.safe_dump(SHORT_PUSH), encoding='utf-8')
    path.write_text(yaml.safe_dump({**CONTENT, 'scenario': str(scenario)}), encoding='utf-8')
    return path


@pytest.fixture(scope='module')
def done(study):
    """The folder of the results of the study, and what the command printed."""
    folder = study.with_name('results')
    finished = call('study', study, '--output', folder)
    assert finished.returncode == 0
    return folder, finished.stdout


@pytest.fixture
def results(done, tmp_path):
    return shutil.copytree(done[0], tmp_path / 'results')


def test_it_prints_the_share_that_passed_and_the_worst_runs(done):
    folder, text = done
    assert 'tried, 40 runs, seed 1' in text
    assert 'peak_pitch_deg [°]' in text
    assert 'passed   ' in text
    assert f'ballbot study rerun {folder} ' in text


def test_the_options_take_the_place_of_the_files(command, study, tmp_path):
    folder = tmp_path / 'results'
    options = ('--runs', 5, '--seed', 7, '--output', folder, '--json')
    status, text, _ = command('study', study, *options)
    answer = json.loads(text)
    assert (status, answer['runs'], answer['seed'], answer['results']) == (0, 5, 7, str(folder))
    assert answer['measures']['peak_pitch_deg']['unit'] == '°'


def test_another_grid_than_that_of_the_file_is_named(command, study, tmp_path):
    grids = {
        'plant_sim.backlash': {'grid': [0.0, 0.1, 9]},
        'plant_sim.duration': {'list': [1.0, 1.1]},
    }
    content = {**yaml.safe_load(study.read_text()), 'sampling': 'grid', 'vary': grids}
    content.pop('runs')
    own = tmp_path / 'grid.yaml'
    own.write_text(yaml.safe_dump(content), encoding='utf-8')
    for runs, note in ((7, 'note: the nearest grid has 4 × 2 points; 8 runs\n'), (6, '')):
        status, _, error = command('study', own, '--runs', runs, '--output', tmp_path / str(runs))
        assert status == 0, error
        assert error.endswith(note)
        assert bool(note) == ('note: ' in error)


def test_the_shipped_studies_are_listed(command):
    status, text, _ = command('study')
    assert status == 0
    assert [line.split()[0] for line in text.splitlines()] == [
        'basin', 'clock', 'delay_and_gain', 'failsafe', 'link_phase', 'mechanism', 'robustness',
        'sensitivity', 'task_costs',
    ]  # fmt: skip


def test_a_run_again_has_the_same_duties(command, results):
    for words in ((3,), ('--worst', 'peak_pitch_deg'), ('--failed',)):
        status, text, _ = command('study', 'rerun', results, *words, '--processes', 'none')
        assert 'duties  as in the study: ' in text
        assert status in (0, 1)


@pytest.mark.graph
def test_a_run_again_in_the_graph_has_the_same_duties(domain, results):
    """By default it is the node graph, with its recording."""
    words = ('study', 'rerun', str(results), '3')
    done = subprocess.run(
        [*BALLBOT, *words], env=environment(domain), capture_output=True, text=True, check=False,
        timeout=LAST_RESORT_S,
    )  # fmt: skip
    assert 'duties  as in the study: ' in done.stdout, done.stderr
    assert (results / 'reruns/3/tried_3.mcap').exists()


def test_the_files_of_a_run_again_are_the_run(command, results, tmp_path):
    command('study', 'rerun', results, 5, '--processes', 'none')
    folder = results / 'reruns/5'
    words = ('--params', folder / 'parameters.yaml', '--processes', 'none', '--json')
    words += ('--output', tmp_path / 'run')
    _, text, _ = command('run', folder / 'tried_5.yaml', *words)
    _, again, _ = command('study', 'rerun', results, 5, '--processes', 'none', '--json')
    assert json.loads(text)['duty_sha256'] == json.loads(again)['duty_sha256']
    assert json.loads(again)['engine'] in ('interpreted', 'compiled')
    assert (results / 'reruns/5_2').is_dir()


@pytest.mark.parametrize(
    ('words', 'message'),
    [
        (('study', 'unheard_of'), "unknown study 'unheard_of'; shipped: basin"),
        (('study', 'absent.yaml'), 'absent.yaml: No such file'),
        (('study', 'robustness', '--runs', 0), '0 is not in the range'),
        (('study', 'clock', '--controller', 'lqgg'), "no controller 'lqgg' (did you mean lqg?)"),
        (('study', 'clock', '--params', 'absent.yaml'), 'absent.yaml: No such file'),
        (('study', 'rerun', 'absent', 3), 'absent'),
        (('study', 'rerun', '{results}'), 'choose the run by its NUMBER'),
        (('study', 'rerun', '{results}', 3, '--failed'), 'choose the run by its NUMBER'),
        (('study', 'rerun', '{results}', 40), '40'),
        (('study', 'rerun', '{results}', '--worst', 'pitch'), 'pitch'),
    ],
)
def test_mistakes_are_told_on_one_line(command, results, words, message):
    status, text, errors = command(*(str(each).format(results=results) for each in words))
    assert (status, text) == (2, '')
    assert errors.startswith('error: ')
    assert message in errors
    assert errors.count('\n') == 1
