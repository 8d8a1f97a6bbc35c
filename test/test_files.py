"""Files that are not regular are refused before they are opened; unwritable ones are named."""

import os
import signal
import socket
import tempfile

import pytest
from click.testing import CliRunner

from ballbot_ros.cli.command import ballbot
from ballbot_ros.errors import BallbotError
from ballbot_ros.files import open_regular, read_bytes, read_text, temporary_folder, write_temporary


@pytest.fixture(autouse=True)
def bounded():
    """End a test that blocks on a FIFO."""

    def give_up(*_):
        raise TimeoutError('it waits')

    before = signal.signal(signal.SIGALRM, give_up)
    signal.alarm(60)
    yield
    signal.alarm(0)
    signal.signal(signal.SIGALRM, before)


@pytest.fixture
def fifo(tmp_path):
    path = tmp_path / 'fifo.yaml'
    os.mkfifo(path)
    return path


def test_a_regular_file_is_read_also_through_a_link(tmp_path):
    (tmp_path / 'file').write_bytes('ψ\r\n'.encode())
    (tmp_path / 'link').symlink_to('file')
    assert read_bytes(tmp_path / 'link') == 'ψ\r\n'.encode()
    assert read_text(tmp_path / 'link') == 'ψ\n'


def test_a_file_that_is_not_regular_is_refused(fifo, tmp_path):
    (tmp_path / 'link').symlink_to(fifo)
    with socket.socket(socket.AF_UNIX) as server:
        server.bind(str(tmp_path / 'socket'))
        for path in (fifo, tmp_path / 'link', tmp_path / 'socket', '/dev/zero'):
            with pytest.raises(OSError, match='not a regular file') as refusal:
                open_regular(path)
            assert refusal.value.filename == str(path)
    with pytest.raises(IsADirectoryError):
        open_regular(tmp_path)


COMMANDS = {
    'info': ['info', 'FIFO'],
    'report': ['report', 'FIFO'],
    'compare': ['compare', 'FIFO', 'FIFO'],
    'replay': ['replay', 'FIFO'],
    'repair': ['repair', 'FIFO'],
    'export': ['export', 'FIFO', '--to', 'csv'],
    'data log': ['export', 'FIFO', '--to', 'log'],
    'run': ['run', 'FIFO', '--processes', 'none', '--no-record'],
    'map': ['map', 'FIFO'],
    'map of a run': ['run', 'stationary', '--no-record', '--set', 'plant_sim.map=FIFO'],
    'design': ['design', '--params', 'FIFO'],
    'codegen': ['codegen', '--output', 'OUTPUT', '--params', 'FIFO'],
}


@pytest.mark.parametrize('name', COMMANDS)
def test_no_command_blocks_on_a_fifo(fifo, tmp_path, name):
    paths = {'FIFO': str(fifo), 'OUTPUT': str(tmp_path / 'output')}
    words = [paths.get(word, word.replace('FIFO', str(fifo))) for word in COMMANDS[name]]
    error = CliRunner().invoke(ballbot, words).exception
    assert isinstance(error, BallbotError)
    assert str(error) == f'{fifo}: not a regular file'
    assert list(tmp_path.iterdir()) == [fifo]


@pytest.mark.parametrize('command', ['info', 'report', 'repair'])
@pytest.mark.parametrize('folder', ['.', '/'])
def test_a_folder_is_not_a_recording(command, folder):
    done = CliRunner().invoke(ballbot, [command, folder])
    assert done.exit_code == 2
    assert f'{folder}: is a folder; name a recording' in done.output


def test_a_missing_folder_for_temporary_files_is_one_line(tmp_path, monkeypatch):
    monkeypatch.setattr(tempfile, 'tempdir', str(tmp_path / 'no'))
    with pytest.raises(BallbotError, match=rf'^{tmp_path}/no: No such file or dir.*; set TMPDIR'):
        temporary_folder()

    def nowhere():
        raise FileNotFoundError(2, "No usable temporary directory found in ['/tmp']")

    monkeypatch.setattr(tempfile, 'gettempdir', nowhere)
    monkeypatch.setattr(tempfile, 'tempdir', None)
    with pytest.raises(BallbotError, match=r"^temporary files: No .* \['/tmp'\]; set TMPDIR"):
        temporary_folder()


def test_temporary_files_are_named_in_utf_8(tmp_path, monkeypatch):
    folder = tmp_path / 't\udcff'
    folder.mkdir()
    monkeypatch.setattr(tempfile, 'tempdir', str(folder))
    with pytest.raises(BallbotError, match=r"t\\udcff/ballbot_.*': not UTF-8; set TMPDIR"):
        temporary_folder()
    assert list(folder.iterdir()) == []


def test_a_full_folder_for_temporary_files_is_named(tmp_path):
    path = tmp_path / 'attachments' / 'scenario.yaml'
    path.parent.mkdir()
    path.symlink_to('/dev/full')
    with pytest.raises(BallbotError, match=rf'^{path}: No space left on device; set TMPDIR'):
        write_temporary(path, b'x' * 10_000)
