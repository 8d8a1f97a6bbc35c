"""The table of commands, whose modules are imported only when they are called."""

import subprocess
import sys

import click
import pytest
from click.shell_completion import ShellComplete
from click.testing import CliRunner

from ballbot_ros.cli.command import COMMANDS, ballbot, invoke, load_command

HEAVY = ('numpy', 'matplotlib', 'rclpy', 'rosbags', 'scipy', 'viser')


def imported_by(code):
    """Return the heavy modules that are imported after `code` has run in a new process."""
    code += (
        f'\nimport sys; print(*(name for name in {HEAVY} if name in sys.modules), file=sys.stderr)'
    )
    done = subprocess.run([sys.executable, '-c', code], capture_output=True, text=True, check=True)
    return done.stderr.split()


def test_every_row_names_a_module_with_that_command():
    for name in COMMANDS:
        command = load_command(name)
        assert isinstance(command, click.Command), name
        assert command.name == name


def test_the_help_line_is_only_in_the_table():
    """Help shows the line in the table; a copy at the command would become outdated unnoticed."""
    shown = CliRunner().invoke(ballbot, ['--help'], terminal_width=100).output
    width = max(map(len, COMMANDS))
    for name, line in COMMANDS.items():
        assert load_command(name).short_help is None, name
        assert f'  {name:<{width}}  {line}\n' in shown


@pytest.mark.parametrize('word', ['--help', '--version'])
def test_the_group_imports_no_command(word):
    code = (
        'import sys; from ballbot_ros.cli import main, command; '
        f"sys.argv[1:] = [{word!r}]; command.invoke(command.ballbot, 'ballbot')"
    )
    assert imported_by(code) == []


def test_no_command_needs_ros_to_be_declared():
    code = 'from ballbot_ros.cli.command import COMMANDS, load_command\n'
    imported = imported_by(f'{code}for name in COMMANDS: load_command(name)')
    assert not {'rclpy', 'viser'} & set(imported)


@pytest.mark.parametrize(
    ('before', 'incomplete', 'found'),
    [
        ([], 'rep', ['repair', 'replay', 'report']),
        (['run'], '--proc', ['--processes']),
        (['run', '--processes'], 'sep', ['separate']),
        (['stationary'], '--proc', ['--processes']),
    ],
    ids=str,
)
def test_completion(before, incomplete, found):
    completion = ShellComplete(ballbot, {}, 'ballbot', '_BALLBOT_COMPLETE')
    items = completion.get_completions(before, incomplete)
    assert [item.value for item in items] == found


@pytest.mark.parametrize(
    ('words', 'told'),
    [
        (['runn'], "no command or scenario 'runn': did you mean run?"),
        (['stationry'], "no command or scenario 'stationry': did you mean stationary?"),
        (
            ['run', 'stationry'],
            "unknown scenario 'stationry' (did you mean stationary?); shipped: ",
        ),
        (['zzz'], "unknown scenario 'zzz'; shipped: "),
        (['stationry.yaml'], 'stationry.yaml: No such file or directory'),
        (['stationary', '--profile', 'hardwar'], '(did you mean hardware?); known: ideal'),
        (['stationary', '--controller', 'lqgg'], "no controller 'lqgg' (did you mean lqg?): give"),
        (['stationary', '--set', 'controler.a_b=0'], "'controler' (did you mean controller?)"),
        (['map', 'trak'], "unknown map 'trak' (did you mean track?); shipped: corridor"),
        (['study', 'robustnes'], "'robustnes' (did you mean robustness?); shipped: basin"),
        (['study', 'reprt', 'studies/basin'], "study 'reprt': did you mean study report?"),
        (['run', 'push', '--external', 'gyro_drivr'], "'recorder' (did you mean gyro_driver?)"),
        (['run', 'push', '--processes', 'on'], "'none' (did you mean one?)"),
        (['conform', 'sonar_drivr'], "'recorder' (did you mean sonar_driver?)"),
        (['design', '--method', 'plce'], "'lqg' (did you mean place?)"),
        (['codegen', '--mode', 'remot'], "'autonomous' (did you mean remote?)"),
        (['render', __file__, '--output', 'x.png', '--view', 'chasr1'], 'you mean chaser1 or'),
        (['--output', 'x'], '--output: name the command first, as in `scripts/run run --output`'),
        (['--nosuch'], "No such option '--nosuch'."),
    ],
    ids=' '.join,
)
def test_a_wrong_word_gets_a_suggestion(words, told, capsys, monkeypatch):
    monkeypatch.setenv('BALLBOT_COMMAND', 'scripts/run')
    monkeypatch.setattr(sys, 'argv', ['ballbot', *words])
    assert invoke(ballbot, 'ballbot') == 2
    shown = capsys.readouterr().err
    assert told in shown
    assert shown.count('\n') == 1


@pytest.mark.parametrize(
    'words',
    [
        ['run', 'push', '--real-time-factor', 'nan'],
        *(['render', __file__, '--output', 'x.mp4', name, 'nan'] for name in ('--rate', '--start')),
    ],
    ids=' '.join,
)
def test_an_option_that_takes_a_number_refuses_nan(words, capsys, monkeypatch):
    monkeypatch.setenv('BALLBOT_COMMAND', 'scripts/run')
    monkeypatch.setattr(sys, 'argv', ['ballbot', *words])
    assert invoke(ballbot, 'ballbot') == 2
    shown = capsys.readouterr().err
    assert shown == f"error: Invalid value for '{words[-2]}': 'nan' is not a number\n"


def test_no_call_of_the_middleware_can_hold_a_run():
    code = 'from ballbot_ros.cli import result; from ballbot_ros.run import separate_processes'
    assert 'rclpy' not in imported_by(code)
