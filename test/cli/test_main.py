import errno
import os
import subprocess
import sys
from pathlib import Path

import click
import pytest
from graph import BALLBOT, call_main, environment

from ballbot_ros.cli.command import invoke
from ballbot_ros.recording.reader import RecordingReader


class InterruptedImport:
    """Simulates Ctrl-C while the next module is searched for."""

    def find_spec(self, *arguments):
        raise KeyboardInterrupt


def test_ctrl_c_while_modules_load_ends_quietly(monkeypatch, capsys):
    monkeypatch.delitem(sys.modules, 'ballbot_ros.cli.command', raising=False)
    monkeypatch.setattr(sys, 'meta_path', [InterruptedImport()])
    assert call_main() == 130
    assert capsys.readouterr() == ('', '')


@pytest.mark.parametrize('words', [['scenarios'], ['design']], ids=' '.join)
def test_unprintable_output_is_one_line(words):
    with Path('/dev/full').open('w') as full:
        done = subprocess.run(
            [*BALLBOT, *words], stdout=full, stderr=subprocess.PIPE, text=True, check=False
        )
    assert done.stderr == 'error: standard output: No space left on device\n'
    assert done.returncode == 2


def test_an_error_without_a_file_is_not_one_of_the_output(monkeypatch, capsys):
    @click.command
    def command():
        raise OSError(errno.EIO, os.strerror(errno.EIO))

    monkeypatch.setattr(sys, 'argv', ['ballbot'])
    assert invoke(command, 'ballbot', failed=1) == 1
    assert capsys.readouterr().err == 'error: Input/output error\n'


def test_a_closed_standard_output_is_not_an_error():
    done = subprocess.run(
        ['sh', '-c', '"$@" >&-', 'sh', *BALLBOT, 'scenarios'], capture_output=True, check=False
    )
    assert (done.returncode, done.stderr) == (0, b'')


@pytest.mark.graph
@pytest.mark.parametrize('processes', ['none', 'separate'])
def test_a_run_needs_no_standard_streams(tmp_path, domain, processes):
    """If they stayed closed, libraries would print into the recording."""
    pytest.importorskip('rclpy')
    words = ['run', 'stationary', '--set', 'plant_sim.duration=0.1', '--processes', processes]
    done = subprocess.run(
        ['sh', '-c', '"$@" <&- >&- 2>&-', 'sh', *BALLBOT, *words, '--output', tmp_path],
        env=environment(domain), check=False,
    )  # fmt: skip
    assert done.returncode == 1  # too short to meet the expectations
    with RecordingReader(tmp_path / 'stationary.mcap') as recording:
        assert recording.damage is None
        assert sum(1 for _ in recording.raw_messages(['/motor_duty'])) == 25


def test_characters_that_the_encoding_lacks_are_escaped():
    done = subprocess.run(
        [*BALLBOT, 'design'], env={**os.environ, 'PYTHONIOENCODING': 'ascii'},
        capture_output=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith(rb'State equation (3.24), state \u03b8 ')
