"""`ballbot doctor`: whether this machine computes what every other one does."""

import dataclasses
import subprocess

import pytest
from graph import BALLBOT, environment

from ballbot_ros.cli import doctor
from ballbot_ros.errors import BallbotError
from ballbot_ros.simulation import golden


@pytest.fixture
def only_arithmetic(monkeypatch):
    monkeypatch.setattr(doctor, '_CHECKS', {'arithmetic': doctor._arithmetic})


def test_a_machine_with_the_golden_hashes_passes(only_arithmetic, capsys):
    assert doctor.examine() == 0
    assert capsys.readouterr().out == (
        'OK   arithmetic stationary and hardware_autonomous have the duty_sha256 of every machine\n'
    )


@pytest.mark.parametrize(
    ('changes', 'named'),
    [
        ({'arithmetic': '0123456789'}, 'the arithmetic has the hash '),
        ({'scenarios': {'stationary': '0123456789'}}, 'the run stationary has the hash '),
    ],
)
def test_a_machine_with_another_hash_fails_with_both_hashes(
    only_arithmetic, monkeypatch, capsys, changes, named
):
    wrong = dataclasses.replace(golden.load_golden(), **changes)
    monkeypatch.setattr(doctor, 'load_golden', lambda: wrong)
    assert doctor.examine() == 1
    [line] = capsys.readouterr().out.splitlines()
    assert line.startswith(f'FAIL arithmetic {named}')
    assert 'here and 01234567… elsewhere' in line


@pytest.mark.parametrize('text', [None, '', 'scenarios: 3', '{', 'arithmetic: x'])
def test_a_missing_or_damaged_golden_file_is_one_line(
    only_arithmetic, monkeypatch, capsys, tmp_path, text
):
    if text is not None:
        (tmp_path / 'config').mkdir()
        (tmp_path / golden.GOLDEN_FILE).write_text(text)
    monkeypatch.setattr(golden, 'share_directory', lambda: tmp_path)
    with pytest.raises(BallbotError, match='missing or damaged'):
        golden.load_golden()
    assert doctor.examine() == 1
    [line] = capsys.readouterr().out.splitlines()
    assert line.endswith('golden.yaml: missing or damaged')


def test_a_sine_of_the_c_library_is_noticed(monkeypatch):
    """Its last bits differ, which the duties of a scenario need not show."""
    import math

    before = golden.arithmetic_sha256()
    monkeypatch.setattr(golden, 'sine_cosine', lambda angle: (math.sin(angle), math.cos(angle)))
    assert golden.arithmetic_sha256() != before == golden.load_golden().arithmetic


@pytest.mark.graph
def test_the_command_makes_every_check(domain):
    done = subprocess.run(
        [*BALLBOT, 'doctor'],
        capture_output=True, text=True, env=environment(domain), check=False, timeout=60,
    )  # fmt: skip
    lines = done.stdout.splitlines()
    assert [line.split()[1] for line in lines] == list(doctor._CHECKS), done.stdout + done.stderr
    assert done.returncode == 0, done.stdout
