"""The folder of a run: a new one for each run, and none that stays empty."""

import errno
from datetime import datetime
from pathlib import Path
from types import SimpleNamespace

import pytest

from ballbot_ros.engine.scenario.scenario import Scenario
from ballbot_ros.errors import BallbotError
from ballbot_ros.parameters import ParameterSet
from ballbot_ros.run import execution as output_folder
from ballbot_ros.run.execution import OutputFiles, output_files
from ballbot_ros.run.spec import RunSpec

NOW = datetime(2026, 1, 2, 3, 4, 5)


def spec_of(*, output=None, record=True):
    return RunSpec(Scenario('push'), ParameterSet(), output=output, record=record)


def test_runs_of_one_second_have_folders_of_their_own(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(output_folder, 'datetime', SimpleNamespace(now=lambda: NOW))
    with (
        output_files(spec_of()) as first,
        output_files(spec_of()) as second,
        output_files(spec_of()) as third,
    ):
        folders = [str(files.recording.parent) for files in (first, second, third)]
        assert folders == [f'runs/2026-01-02_03-04-05_push{end}' for end in ('', '_2', '_3')]
        second.recording.touch()
    assert [str(path) for path in (tmp_path / 'runs').rglob('*')] == [
        str(tmp_path / folders[1]),
        str(tmp_path / second.recording),
    ]


def test_a_run_without_files_has_no_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with output_files(spec_of(record=False)) as files:
        assert files == OutputFiles()
    assert list(tmp_path.iterdir()) == []


def test_a_recording_is_never_overwritten_but_a_folder_may_be_used_again(tmp_path):
    for record in (True, False):
        with output_files(spec_of(output=tmp_path / 'run', record=record)) as files:
            assert files.recording == (tmp_path / 'run/push.mcap' if record else None)
            assert files.figure == tmp_path / 'run/push.png'
            if record:
                files.recording.touch()
    with (
        pytest.raises(BallbotError, match=r'push\.mcap: already exists; choose another --output'),
        output_files(spec_of(output=tmp_path / 'run')),
    ):
        pass
    assert [path.name for path in (tmp_path / 'run').iterdir()] == ['push.mcap']


def test_nothing_in_the_folder_is_touched(tmp_path):
    own = tmp_path / '.ballbot_probe'  # a name that the check of the folder once used
    own.write_text('mine')
    with output_files(spec_of(output=tmp_path)):
        pass
    assert own.read_text() == 'mine'


def test_a_disk_that_has_failed_does_not_hide_the_result(tmp_path, monkeypatch):
    def fail(path):
        raise OSError(errno.EBADMSG, 'Bad message', str(path))

    with output_files(spec_of(output=tmp_path / 'run')) as files:
        monkeypatch.setattr(Path, 'iterdir', fail)
    assert files.recording == tmp_path / 'run/push.mcap'
