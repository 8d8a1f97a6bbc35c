"""Commands that output and written files recommend can be pasted into the user's shell."""

import shlex
import sys
from pathlib import Path

import pytest

from ballbot_ros.files import COMMAND_ENV, next_steps, own_command, program

HERE = Path(sys.executable).with_name('ballbot')


@pytest.fixture
def called(monkeypatch, tmp_path):
    """Set how the command was called; '' for a direct call. The current folder is a new one."""
    monkeypatch.chdir(tmp_path)

    def set_call(words, path=''):
        monkeypatch.setenv(COMMAND_ENV, words)
        monkeypatch.setenv('PATH', path)
        return tmp_path

    return set_call


def test_the_name_is_enough_only_where_it_is_found(called):
    called('', str(HERE.parent))
    assert own_command('report', 'a b.mcap') == "ballbot report 'a b.mcap'"
    called('')
    assert own_command('report', 'x') == f'{shlex.quote(str(HERE))} report x'


def test_next_steps_use_the_script_that_was_called(called):
    called('scripts/run')
    assert next_steps(Path('runs/a b/push.mcap')) == [
        "report it  scripts/run report 'runs/a b/push.mcap'",
        "watch it   scripts/run view 'runs/a b/push.mcap'",
    ]


def test_another_folder_has_its_own_path_to_the_script(called, tmp_path):
    called(r'my\ clone/scripts/run')
    (tmp_path / 'real' / 'deep').mkdir(parents=True)
    (tmp_path / 'link').symlink_to('real/deep')
    assert program(folder=Path('made')) == "'../my clone/scripts/run'"
    assert program(folder=Path('link')) == "'../../my clone/scripts/run'"
    for words in ('ballbot', '/opt/clone/scripts/run'):
        called(words)
        assert program(folder=Path('made')) == words


QUIET = Path(__file__).parents[1] / 'config/gains/quiet.yaml'


@pytest.mark.parametrize(
    'words',
    [('new', 'controller', 'my_pid'), ('codegen', '--params', str(QUIET), '--output', 'c')],
)
def test_commands_in_a_written_readme_run_in_its_folder(called, command, words):
    folder = called('scripts/run')
    (folder / 'scripts').mkdir()
    (folder / 'scripts/run').touch()
    status, printed, error = command(*words)
    assert (status, error) == (0, '')
    assert 'scripts/run ' in printed
    assert 'ballbot run' not in printed
    written = folder / words[-1]
    text = (written / 'README.md').read_text()
    found = [word for word in text.replace('`', ' ').split() if word.endswith('scripts/run')]
    assert len(found) > 1
    assert {(written / each).resolve() for each in found} == {folder / 'scripts/run'}
    assert 'ballbot codegen' not in text.replace('ballbot_ros', '')
