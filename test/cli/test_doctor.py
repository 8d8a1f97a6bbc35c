"""`ballbot doctor`: whether this machine computes what every other one does."""

import subprocess

import pytest
from graph import BALLBOT, environment

from ballbot_ros.cli import doctor


@pytest.fixture
def only_arithmetic(monkeypatch):
    monkeypatch.setattr(doctor, '_CHECKS', {'arithmetic': doctor._arithmetic})


def test_a_machine_that_gives_the_golden_hash_is_well(only_arithmetic, capsys):
    assert doctor.examine() == 0
    golden = doctor.golden_hashes()[doctor.GOLDEN_SCENARIO]
    assert capsys.readouterr().out.startswith('OK   arithmetic hardware_autonomous')
    assert len(golden) == 64


def test_a_machine_that_gives_another_hash_is_told_so(only_arithmetic, monkeypatch, capsys):
    monkeypatch.setattr(doctor, 'golden_hashes', lambda: {doctor.GOLDEN_SCENARIO: '0123456789'})
    assert doctor.examine() == 1
    [line] = capsys.readouterr().out.splitlines()
    assert line.startswith('FAIL arithmetic hardware_autonomous has the duty_sha256 ')
    assert 'and 01234567… elsewhere' in line


@pytest.mark.graph
def test_the_command_makes_every_check(domain):
    done = subprocess.run(
        [*BALLBOT, 'doctor'],
        capture_output=True, text=True, env=environment(domain), check=False, timeout=60,
    )  # fmt: skip
    lines = done.stdout.splitlines()
    assert [line.split()[1] for line in lines] == list(doctor._CHECKS), done.stdout + done.stderr
    assert done.returncode == 0, done.stdout
