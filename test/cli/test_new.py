"""`ballbot new controller`: the package runs and passes its tests as it is, and installed."""

import json
import os
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from graph import BALLBOT

from ballbot_ros.controllers import new_package

PROJECT = Path(__file__).parents[2]
TOOLS = os.pathsep.join([str(Path(sys.executable).parent), os.environ['PATH']])
WITHOUT_NODES = ('--processes=none', '--no-record', '--json')


def call(*words, cwd, pythonpath=(PROJECT,), **environment):
    """Run a program that finds this source tree; return the completed process."""
    # The variables of pytest's own options and plugins are not those of a new user.
    own = {key: value for key, value in os.environ.items() if not key.startswith('PYTEST_')}
    return subprocess.run(
        [*map(str, words)],
        cwd=cwd,
        env={
            **own,
            'PATH': TOOLS,
            'PYTHONPATH': os.pathsep.join(map(str, pythonpath)),
            'PYTEST_DISABLE_PLUGIN_AUTOLOAD': '1',
            **environment,
        },
        capture_output=True,
        text=True,
        check=False,
    )


def assert_passed(done):
    """Assert that a run whose result is JSON passed without a warning, unless of slow ticks."""
    lines = done.stderr.splitlines()
    assert [each for each in lines if 'ticks took longer than 4 ms' not in each] == []
    assert json.loads(done.stdout)['outcome'] == 'passed', done.stdout


@pytest.fixture(scope='module')
def made(tmp_path_factory):
    """A folder with a new package, and what the command printed."""
    folder = tmp_path_factory.mktemp('new')
    done = call(*BALLBOT, 'new', 'controller', 'my_pid', cwd=folder)
    assert (done.returncode, done.stderr) == (0, '')
    return folder, done.stdout


def test_it_prints_the_files_and_the_next_commands(made):
    folder, printed = made
    files, commands = printed.split('\n\n')
    written = {line.removeprefix('wrote  ') for line in files.splitlines()}
    assert written == {
        str(path.relative_to(folder))
        for path in (folder / 'my_pid').rglob('*')
        if path.is_file() and 'cache' not in str(path)
    }
    words = [shlex.split(line.partition(':')[2]) for line in commands.splitlines()]
    assert [each[-1] for each in words] == [
        'my_pid/scenarios/my_pid.yaml', 'my_pid[test]', 'my_pid', 'my_pid',
    ]  # fmt: skip
    assert words[0][:2] == ['ballbot', 'run']


def test_its_tests_pass_without_an_installation(made):
    folder, _ = made
    for where, argument in ((folder, 'my_pid'), (folder / 'my_pid', '-krest')):
        done = call(sys.executable, '-m', 'pytest', '-q', argument, cwd=where)
        assert done.returncode == 0, done.stdout + done.stderr


def test_its_scenario_passes_without_an_installation(made):
    """From any folder, with parameters that the scenario and the command set."""
    words = ['--set', 'controller.user.kd_pitch=0.2', *WITHOUT_NODES]
    done = call(*BALLBOT, 'run', made[0] / 'my_pid/scenarios/my_pid.yaml', *words, cwd='/')
    assert_passed(done)


def test_its_tests_fail_if_it_does_not_balance(made, tmp_path):
    shutil.copytree(made[0] / 'my_pid', tmp_path / 'my_pid')
    file = tmp_path / 'my_pid/my_pid/controller.py'
    text = file.read_text()
    assert '+ gains.kd_pitch' in text
    file.write_text(text.replace('+ gains.kd_pitch', '- gains.kd_pitch'))
    done = call(sys.executable, '-m', 'pytest', '-q', '-kideal or falls', 'my_pid', cwd=tmp_path)
    assert done.returncode == 1
    assert '2 failed' in done.stdout


def test_colcon_builds_and_tests_it_and_its_name_is_known(made, tmp_path):
    if not (colcon := shutil.which('colcon', path=TOOLS)):
        pytest.skip('colcon is not installed')
    shutil.copytree(made[0] / 'my_pid', tmp_path / 'src/my_pid')
    for words in (['build'], ['test', '--pytest-args', '-krest']):
        # Colcon's own pytest plugin has to load.
        done = call(colcon, *words, cwd=tmp_path, PYTEST_DISABLE_PLUGIN_AUTOLOAD='')
        assert done.returncode == 0, done.stdout + done.stderr
    results = call(colcon, 'test-result', '--all', cwd=tmp_path)
    assert 'Summary: 1 test, 0 errors, 0 failures, 0 skipped' in results.stdout
    shutil.rmtree(tmp_path / 'src')
    sourced = 'source install/local_setup.bash && exec "$@"'
    run = ['run', 'stationary', '--controller', 'my_pid', *WITHOUT_NODES]
    done = call('bash', '-c', sourced, 'bash', *BALLBOT, *run, cwd=tmp_path)
    assert_passed(done)


def test_pip_installs_it(made, tmp_path):
    install = ['-m', 'pip', 'install', '--quiet', '--no-deps', '--target', tmp_path / 'site']
    shutil.copytree(made[0] / 'my_pid', tmp_path / 'my_pid')
    done = call(sys.executable, *install, './my_pid', cwd=tmp_path, PIP_RETRIES='0')
    if 'No matching distribution found for setuptools' in done.stderr:
        pytest.skip('no network to get setuptools')
    assert done.returncode == 0, done.stderr
    code = (
        'from ballbot_ros.controllers.loading import load_controller\n'
        "loaded = load_controller('my_pid')\n"
        'print(loaded.cls.__name__, loaded.code.path, loaded.code.source.suffix)'
    )
    site = tmp_path / 'site'
    done = call(sys.executable, '-c', code, cwd='/', pythonpath=(PROJECT, site))
    assert done.stdout == f'MyPid {site}/my_pid/controller.py .zip\n', done.stderr


def test_an_editable_installation_works_next_to_its_folder(made, tmp_path):
    """In the folder above, Python finds a namespace of the same name first."""
    shutil.copytree(made[0] / 'my_pid', tmp_path / 'my_pid')
    install = ['-m', 'pip', 'install', '--quiet', '--no-deps', '--prefix', tmp_path / 'prefix']
    done = call(sys.executable, *install, '-e', './my_pid', cwd=tmp_path, PIP_RETRIES='0')
    if 'No matching distribution found for setuptools' in done.stderr:
        pytest.skip('no network to get setuptools')
    assert done.returncode == 0, done.stderr
    (site,) = (tmp_path / 'prefix').rglob('site-packages')
    code = (
        f'import site; site.addsitedir({str(site)!r})\n'
        'from ballbot_ros.controllers.loading import load_controller\n'
        "print(load_controller('my_pid').code.shown)"
    )
    done = call(sys.executable, '-c', code, cwd=tmp_path, pythonpath=(PROJECT, tmp_path))
    assert done.stdout == 'my_pid/my_pid/controller.py\n', done.stderr


@pytest.mark.parametrize(
    ('name', 'reason'),
    [
        *((bad, 'is not the name of a package') for bad in (
            'MyPid', '2pid', '_pid', 'pid_', 'my__pid', 'my-pid', 'my pid', 'a/b', '../pid', '',
            'π', 'pid\n',
        )),
        ('x' * 31, 'has more than 30 characters'),
        ('lambda', 'is a keyword of Python'),
        *((bad, 'is the name of another file or folder of the package') for bad in (
            'scenarios', 'test', 'build', 'resource', 'setup',
        )),
        *((bad, 'there is already a controller') for bad in ('python', 'c', 'arm')),
        *((bad, 'there is already a Python module') for bad in (
            'numpy', 'ballbot_ros', 'json', 'sys',
        )),
        ('x', 'has at least two characters'),
    ],
)  # fmt: skip
def test_a_bad_name_is_one_line(command, tmp_path, name, reason):
    status, printed, error = command('new', 'controller', name, '--output', tmp_path)
    assert (status, printed) == (2, '')
    assert error.startswith('error: ')
    assert reason in error
    assert error.count('\n') == 1
    assert list(tmp_path.iterdir()) == []


def test_a_name_of_an_installed_controller_is_refused(command, tmp_path, monkeypatch):
    monkeypatch.setattr(new_package, 'installed_controllers', lambda: {'lqg': []})
    status, _, error = command('new', 'controller', 'lqg', '--output', tmp_path)
    assert status == 2
    assert error == "error: there is already a controller 'lqg'; choose another name\n"


def test_an_existing_folder_is_refused_and_untouched(command, tmp_path):
    (tmp_path / 'my_pid').mkdir()
    (tmp_path / 'my_pid/notes').write_text('mine')
    (tmp_path / 'link').symlink_to('nowhere')
    for name in ('my_pid', 'link'):
        status, _, error = command('new', 'controller', name, '--output', tmp_path)
        assert status == 2
        reason = 'already exists; choose another name or --output'
        assert error == f'error: {tmp_path / name}: {reason}\n'
    assert {path.name for path in tmp_path.rglob('*')} == {'my_pid', 'notes', 'link'}


def test_a_folder_that_cannot_be_written_is_one_line(command, tmp_path):
    (tmp_path / 'file').touch()
    for output, reason in ((tmp_path / 'file', 'Not a directory'), ('/proc/x', 'No such file')):
        status, _, error = command('new', 'controller', 'my_pid', '--output', output)
        assert status == 2
        assert error.startswith(f'error: {output}')
        assert reason in error
        assert error.count('\n') == 1


def test_output_folders_are_created(command, tmp_path):
    status, printed, error = command('new', 'controller', 'my_pid', '--output', tmp_path / 'a b/c')
    assert (status, error) == (0, '')
    assert (tmp_path / 'a b/c/my_pid/setup.py').is_file()
    assert f"ballbot run '{tmp_path}/a b/c/my_pid/scenarios/my_pid.yaml'\n" in printed
