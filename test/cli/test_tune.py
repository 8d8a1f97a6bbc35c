"""`ballbot tune`: what it finds and prints, interruptions, and its mistakes."""

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from graph import BALLBOT, LAST_RESORT_S, call, wait_for
from tried_searches import TUNING, files_in, write

from ballbot_ros.cli import install

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope='module')
def tuning(tmp_path_factory):
    return write(tmp_path_factory.mktemp('tune'), TUNING)


@pytest.fixture(scope='module')
def done(tuning):
    """The folder of the results, and what the command printed."""
    folder = tuning.with_name('results')
    finished = call('tune', tuning, '--output', folder)
    assert finished.returncode == 0, finished.stderr
    return folder, finished.stdout


def test_it_prints_start_and_result_and_how_to_run_it(done):
    folder, text = done
    for each in ('tried, 16 candidates', 'controller.k_f.2', 'objective, mean', '8 unseen'):
        assert each in text
    assert f'parameters  {folder / "tuned.yaml"}' in text
    assert f'report      {folder / "report/index.html"}' in text
    assert (folder / 'report/index.html').read_text().startswith('<!')
    assert 'run it' not in text  # short_push is a file of its own


def test_json_of_a_finished_tuning(command, done, tuning):
    folder, _ = done
    before = files_in(folder)
    status, text, errors = command('tune', tuning, '--output', folder, '--json')
    answer = json.loads(text)
    assert (status, answer['tuning'], answer['candidates']) == (0, 'tried', 16), errors
    assert answer['feasible']
    assert answer['parameters'].keys() == {'controller.k_f.2', 'controller.k_f.4'}
    assert answer['searched']['tuned']['objective'] <= answer['searched']['start']['objective']
    assert answer['unseen'].keys() == {'start', 'tuned'}
    assert files_in(folder) == before


def test_a_limit_that_no_candidate_keeps_is_told(command, tmp_path):
    path = write(tmp_path, TUNING, limits={'peak_pitch_deg': {'max': 0.1}}, candidates=8)
    status, text, errors = command('tune', path, '--output', tmp_path / 'results')
    assert (status, errors.count('Traceback')) == (1, 0)
    assert 'note: no candidate keeps all limits on the 4 robots of the search' in text


def test_the_shipped_tunings_are_listed(command):
    status, text, _ = command('tune')
    assert status == 0
    assert 'quiet' in [line.split()[0] for line in text.splitlines()]


def test_signals_lose_nothing(done, tuning, tmp_path):
    """One tuning, which signals stop at any moment: while it loads, searches or reports."""
    output = tmp_path / 'results'
    core = str(min(os.sched_getaffinity(0)))
    words = ['taskset', '--cpu-list', core, *BALLBOT, 'tune', str(tuning), '--output', str(output)]
    for number, times in ((signal.SIGINT, 2), (signal.SIGKILL, 1)):
        known = len(files_in(output))
        with subprocess.Popen(
            words, env={**os.environ, 'PYTHONPATH': str(ROOT)}, text=True, stderr=subprocess.PIPE,
            stdout=subprocess.PIPE,
        ) as process:  # fmt: skip
            wait_for(
                lambda p=process, k=known: len(files_in(output)) > k or p.poll() is not None,
                'a part',
            )
            for _ in range(times):
                process.send_signal(number)
            _, errors = process.communicate(timeout=LAST_RESORT_S)
        assert process.returncode == (-number if number == signal.SIGKILL else 128 + number)
        assert 'Traceback' not in errors
        if number == signal.SIGINT:
            assert 'the same command goes on from there' in errors
    assert 0 < len(files_in(output)) < len(files_in(done[0]))
    finished = call('tune', tuning, '--output', output)
    assert finished.returncode == 0, finished.stderr
    assert files_in(output) == files_in(done[0])
    tuned = (folder / 'tuned.yaml' for folder in (output, done[0]))
    assert len({each.read_bytes() for each in tuned}) == 1


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_a_signal_between_two_generations_is_told(number):
    program = (
        'import signal; from pathlib import Path; from ballbot_ros.process import ProgramEnd\n'
        'from ballbot_ros.cli.study import resumable\n'
        f"with ProgramEnd(), resumable(Path('here')): signal.raise_signal({number:d})"
    )
    ended = subprocess.run(
        [sys.executable, '-c', program], env={**os.environ, 'PYTHONPATH': str(ROOT)}, text=True,
        stderr=subprocess.PIPE, timeout=LAST_RESORT_S, check=False,
    )  # fmt: skip
    assert ended.returncode == 128 + number
    assert ended.stderr == 'stopped; the same command goes on from there: here\n'


@pytest.mark.parametrize(
    ('words', 'message'),
    [
        (('unheard_of',), "unknown tuning 'unheard_of'; shipped: "),
        (('absent.yaml',), 'absent.yaml: No such file'),
        (('{tuning}', '--candidates', 0), '0 is not in the range'),
        (('{tuning}', '--candidates', 10**30), '--candidates 1'),
        (('{tuning}', '--method', 'guess'), "'guess' is not one of"),
        (('{tuning}', '--controller', 'pid'), 'tried.yaml tunes python'),
        (('{tuning}', '--params', 'absent.yaml'), 'absent.yaml: No such file'),
        (('{tuning}', '--output', '{tuning}'), 'not a folder'),
        (('{tuning}', '--output', '{done}', '--seed', 2), 'has another study'),
        (('{tuning}', '--output', '{done}', '--candidates', 50), 'has another study'),
        (('{tuning}', '--output', '{done}/search'), 'has a study; choose another --output'),
        (('{tuning}', '--output', '{done}', '--method', 'random'), 'its candidates differ'),
        (('{tuning}', '--output', '/proc/nowhere'), 'choose another --output'),
        (('{tuning}', '--cluster', 'nowhere'), 'nowhere'),
    ],
)
def test_mistakes_are_told_on_one_line(done, tuning, words, message):
    finished = call('tune', *(str(each).format(tuning=tuning, done=done[0]) for each in words))
    assert (finished.returncode, finished.stdout) == (2, '')
    errors = [each for each in finished.stderr.splitlines() if not each.startswith('goes on after')]
    assert len(errors) == 1, finished.stderr
    assert errors[0].startswith('error: ')
    assert message in errors[0]


def test_a_missing_package_is_named(command, tuning, tmp_path, monkeypatch):
    monkeypatch.delenv('CI', raising=False)
    monkeypatch.setattr(install, 'missing', lambda extra: ['cma'] * (extra == 'search'))
    status, _, errors = command('tune', tuning, '--output', tmp_path / 'results')
    assert status == 2
    assert 'needs cma: `ballbot install search`' in errors
    assert errors.count('\n') == 1
