"""The processes of a trial: none of them outlives it."""

import os
import signal
import subprocess
import sys
from types import SimpleNamespace

import pytest
from click.testing import CliRunner

from campaign import trial
from campaign.campaign import campaign
from campaign.fault import Verdict
from campaign.site import MARK, Site, processes_of, wait_until

SLEEP = ('timeit', '-n', '1', 'import time; time.sleep(60)')


def test_a_program_that_hangs_is_killed_and_has_no_status(tmp_path):
    with Site(tmp_path, [1]) as site:
        program = site.start('hangs', *SLEEP)
        end = site.await_end(program, bound_s=0.3)
        assert end.status is None
        assert end.took_s > 0.3
        assert program.status == -9
        assert site.alive() == {}


def test_processes_that_outlive_a_program_are_reported_and_killed(tmp_path):
    parent = f'import subprocess, sys; subprocess.Popen([sys.executable, "-m", *{SLEEP!r}])'
    with Site(tmp_path, [1]) as site:
        program = site.start('parent', 'timeit', '-n', '1', '-r', '1', parent)
        wait_until(lambda: program.status is not None, 'its end')
        end = site.await_end(program, bound_s=0.3)
    assert end.status == 0
    assert len(end.survivors) == 1
    assert processes_of(tmp_path) == {}


def test_the_programs_of_a_trial_do_not_ignore_a_hangup_as_with_nohup(tmp_path, monkeypatch):
    handlers = []

    def carry_out(site):
        handlers.append(signal.getsignal(signal.SIGHUP))
        return Verdict((), 0.0, 1.0)

    fault = SimpleNamespace(attempt=lambda seed, number: SimpleNamespace(carry_out=carry_out))
    monkeypatch.setattr(trial, 'BY_NAME', {'hangup': fault})
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        assert trial.main(['hangup', '1', '1', str(tmp_path), '1']) == 0
    finally:
        signal.signal(signal.SIGHUP, before)
    assert handlers == [signal.SIG_DFL]


def test_other_processes_are_left_alone(tmp_path):
    other = subprocess.Popen(
        [sys.executable, '-m', *SLEEP], env={**os.environ, MARK: f'{tmp_path}_2'}
    )
    try:
        with Site(tmp_path, [1]) as site:
            assert site.alive() == {}
        assert other.poll() is None
    finally:
        other.kill()
        other.wait()


@pytest.mark.parametrize(
    'words', [['--only', 'flood'], ['--trial', '3'], ['--minutes', '0'], ['--seed', '-1']]
)
def test_invalid_arguments_are_a_mistake(words):
    assert CliRunner().invoke(campaign, words).exit_code == 2
