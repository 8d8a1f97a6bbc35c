"""`ballbot falsify`: what it finds and prints, and its mistakes."""

import json

import pytest
import yaml
from graph import call
from tried_searches import STUDY, write

from ballbot_ros.cli import install


@pytest.fixture(scope='module')
def study(tmp_path_factory):
    return write(tmp_path_factory.mktemp('falsify'), STUDY)


def falsify(study, folder, *words, processes='none'):
    return call('falsify', study, '--output', folder, '--processes', processes, *words)


@pytest.fixture(scope='module')
def done(study):
    """The folder of the results, and what the command printed."""
    folder = study.with_name('results')
    finished = falsify(study, folder, '--counterexamples', 2)
    assert finished.returncode == 1, finished.stderr
    return folder, finished


def test_it_prints_what_is_violated_and_how_much_was_searched(done):
    folder, finished = done
    assert 'tried, seed 1' in finished.stdout
    assert 'lowest robustness' in finished.stdout
    first, second = (f'{rank}. violates ' for rank in (1, 2))
    assert finished.stdout.index(first) < finished.stdout.index(second)
    for rank in (1, 2):
        (path,) = (folder / 'counterexamples' / str(rank)).glob('*.yaml')
        assert f'ballbot run {path}' in finished.stdout
    assert 'of 48 runs, 5 variables; ' in finished.stdout
    page = folder / 'report/index.html'
    assert f'report    {page}' in finished.stdout
    assert page.exists()
    assert 'safe' not in finished.stdout
    assert 'Traceback' not in finished.stderr


def test_json_and_once_more(done, study):
    folder, _ = done
    again = falsify(study, folder, '--counterexamples', 2, '--json')
    assert again.returncode == 1
    (content,) = json.loads(again.stdout)
    assert (content['study'], content['budget'], content['results']) == ('tried', 48, str(folder))
    assert content['robustness'].keys() == {'peak_position_m', 'upright'}
    for each in content['counterexamples']:
        assert each['reproduced']
        assert each['found'].keys() == STUDY['vary'].keys()
        run = call(
            'run', each['scenario'], '--processes', 'none', '--json',
            '--output', folder.with_name(f'run_{each["number"]}'),
        )  # fmt: skip
        assert run.returncode == 1
        assert json.loads(run.stdout)['duty_sha256'] == each['duty_sha256']


@pytest.mark.graph
def test_the_node_graph_has_the_same_duties(study, tmp_path, domain, monkeypatch):
    monkeypatch.setenv('ROS_DOMAIN_ID', str(domain))
    finished = falsify(
        study, tmp_path / 'results', '--counterexamples', 1, '--json', processes='separate'
    )
    assert finished.returncode == 1, finished.stderr
    (content,) = json.loads(finished.stdout)
    (found,) = content['counterexamples']
    assert found['reproduced']
    (path,) = (tmp_path / 'results/counterexamples/1').glob('*.mcap')
    assert path.stem == f'tried_{found["number"]}'


def test_without_a_counterexample_nothing_is_proven(study, tmp_path):
    content = {**yaml.safe_load(study.read_text()), 'expectations': {'peak_pitch_deg': {'max': 80}}}
    del content['properties']
    study = write(tmp_path, content)
    finished = falsify(study, tmp_path / 'results', '--runs', 20, '--seed', 3)
    assert finished.returncode == 0, finished.stderr
    assert 'searched  20 of 20 runs, 5 variables; 0 runs did not pass' in finished.stdout
    assert 'No counterexample was found, which does not prove' in finished.stdout


def test_each_scenario_has_a_folder(tmp_path):
    path = write(tmp_path, STUDY)
    other = yaml.safe_load((tmp_path / 'short_push.yaml').read_text())
    other['pushes'][0]['force'] = 1.5
    (tmp_path / 'other.yaml').write_text(yaml.safe_dump(other))
    path = write(tmp_path, STUDY, scenario=['short_push.yaml', 'other.yaml'])
    finished = falsify(path, tmp_path / 'results', '--counterexamples', 1, '--method', 'random')
    assert finished.returncode == 1, finished.stderr
    for name in ('short_push', 'other'):
        assert (tmp_path / 'results' / name / 'python/counterexamples/1').is_dir()


@pytest.mark.parametrize(
    ('words', 'message'),
    [
        (('unheard_of',), "unknown study 'unheard_of'; shipped: basin"),
        (('absent.yaml',), 'absent.yaml: No such file'),
        (('{study}', '--runs', 0), '0 is not in the range'),
        (('{study}', '--runs', 10**9), 'at most 1,000,000 are searched'),
        (('{study}', '--counterexamples', 0), '0 is not in the range'),
        (('{study}', '--method', 'guess'), "'guess' is not one of"),
        (('{study}', '--controller', 'lqgg'), "no controller 'lqgg' (did you mean lqg?)"),
        (('{study}', '--params', 'absent.yaml'), 'absent.yaml: No such file'),
        (('{study}', '--output', '{study}'), 'not a folder'),
        (('{study}', '--output', '{done}', '--seed', 2), 'its seed: 1, not 2'),
        (('{study}', '--cluster', 'nowhere'), 'nowhere'),
        ((), "Missing argument 'STUDY'"),
    ],
)
def test_mistakes_are_told_on_one_line(done, study, words, message):
    words = [str(each).format(study=study, done=done[0]) for each in words]
    finished = call('falsify', *words)
    assert (finished.returncode, finished.stdout) == (2, '')
    assert finished.stderr.startswith('error: ')
    assert message in finished.stderr
    assert finished.stderr.count('\n') == 1


def test_a_missing_package_is_named(study, tmp_path, monkeypatch):
    monkeypatch.delenv('CI', raising=False)
    monkeypatch.setattr(install, 'missing', lambda extra: ['cma'] * (extra == 'search'))
    finished = falsify(study, tmp_path / 'results')
    assert (finished.returncode, finished.stdout) == (2, '')
    assert 'needs cma: `ballbot install search`' in finished.stderr
    assert finished.stderr.count('\n') == 1
    # The other method does without.
    few = falsify(study, tmp_path / 'results', '--method', 'random', '--runs', 2)
    assert few.returncode in (0, 1), few.stderr
