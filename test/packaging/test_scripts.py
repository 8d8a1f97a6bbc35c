"""scripts/run and scripts/test on a simulated machine: no network, no real interpreter."""

import contextlib
import os
import shutil
import signal
import subprocess
from pathlib import Path

import pytest
from graph import LAST_RESORT_S, wait_for

ROOT = Path(__file__).resolve().parents[2]
TOOLS = (
    *('bash', 'basename', 'cat', 'chmod', 'cp', 'df', 'dirname', 'env', 'flock', 'grep', 'mkdir'),
    *('mv', 'readlink', 'rm', 'rmdir', 'sha256sum', 'sleep', 'tail', 'uname'),
)

# Answers the calls of the scripts to an interpreter. It is also the interpreter of the environments
# that it creates.
PYTHON = r"""#!/usr/bin/env bash
case "$*" in
  -V) echo "Python $VERSION" ;;
  *ensurepip*) $HAS_VENV ;;
  *rclpy*) $HAS_RCLPY ;;
  *numpy*) echo numpy==1.26.4 ;;
  '-m venv '*)
    echo "$*" >>"$MACHINE/calls"
    mkdir -p "${!#}/bin"
    cp "$0" "${!#}/bin/python"
    ;;
  '-m pip --version') $HAS_PIP ;;
  '-m pip install '*)
    cat "$MACHINE/pip.output" 2>/dev/null
    echo "$*" >>"$MACHINE/calls"
    source "$MACHINE/pip" || exit
    { echo '#!/usr/bin/env bash'; echo 'printf "<%s>\n" "$@"; env'; } >"${0%/*}/ballbot"
    chmod +x "${0%/*}/ballbot"
    ;;
  '-m pytest '*) printf '<%s>\n' "$@"; env ;;
  *) echo "unexpected: $*" >&2; exit 99 ;;
esac
"""


class Machine:
    """A machine with a project, some tools and the interpreters added to it."""

    def __init__(self, folder):
        self.folder = folder
        self.project = folder / 'my project'
        self.environment = {'PATH': str(folder / 'bin'), 'MACHINE': str(folder), 'HOME': '/'}
        (folder / 'bin').mkdir()
        for tool in TOOLS:
            (folder / 'bin' / tool).symlink_to(shutil.which(tool))
        shutil.copytree(ROOT / 'scripts', self.project / 'scripts')
        (self.project / 'ballbot_ros/parameters').mkdir(parents=True)
        (self.project / 'setup.py').write_text('first')
        (self.project / 'pyproject.toml').write_text('first')
        self.pip('')

    @property
    def venv(self):
        return self.project / '.venv'

    @property
    def calls(self):
        file = self.folder / 'calls'
        return file.read_text().splitlines() if file.exists() else []

    def program(self, name, text):
        file = self.folder / 'bin' / name
        file.write_text(text)
        file.chmod(0o755)

    def python(self, name='python3', version='3.11.2', *, venv=True, pip=True, rclpy=False):
        text = PYTHON.replace('$VERSION', version)
        for variable, has in (('VENV', venv), ('PIP', pip), ('RCLPY', rclpy)):
            text = text.replace(f'$HAS_{variable}', 'true' if has else 'false')
        self.program(name, text)

    def pip(self, commands, output=''):
        (self.folder / 'pip').write_text(commands)
        (self.folder / 'pip.output').write_text(output)

    def start(self, script, *arguments, **environment):
        return subprocess.Popen(
            [self.project / 'scripts' / script, *arguments],
            env=self.environment | environment,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
        )

    def run(self, script, *arguments, **environment):
        process = self.start(script, *arguments, **environment)
        process.output, process.errors = process.communicate(timeout=LAST_RESORT_S)
        return process


def await_sleep(process):
    """Wait until the simulated pip sleeps, since a shell about to start it may lose a signal."""
    wait_for(lambda: 'sleep' in programs(process.pid), what='sleep')


def programs(group):
    """Return the names of the programs of a process group."""
    for path in Path('/proc').glob('[0-9]*/stat'):
        with contextlib.suppress(OSError):
            name, _, rest = path.read_text().partition('(')[2].rpartition(')')
            if int(rest.split()[2]) == group:
                yield name


@pytest.fixture
def machine(tmp_path):
    return Machine(tmp_path)


def arguments(process):
    return [line[1:-1] for line in process.output.splitlines() if line.startswith('<')]


def variable(process, name):
    prefix = f'{name}='
    values = [line for line in process.output.splitlines() if line.startswith(prefix)]
    return values[0].removeprefix(prefix) if values else None


def assert_hint(process, *parts):
    """Assert that the last line says what is wrong; progress lines may precede it."""
    assert process.returncode == 2, process.errors
    *progress, hint = process.errors.splitlines()
    assert len(progress) <= 1
    for part in parts:
        assert part in hint
    assert process.output == ''


# --- Missing requirements ------------------------------------------------------------------------


def test_no_python(machine):
    assert_hint(machine.run('run'), 'Python 3.10 to 3.13', 'found none', 'sudo apt install')


@pytest.mark.parametrize('version', ['3.9.18', '3.14.0'])
def test_python_without_ros_wheels(machine, version):
    machine.python(version=version)
    assert_hint(machine.run('run'), 'Python 3.10 to 3.13', version.rpartition('.')[0])


def test_second_python_is_used_if_the_first_does_not_qualify(machine):
    machine.python(version='3.9.18')
    machine.python('python3.12', version='3.12.1', venv=False)
    machine.python('python3.10', version='3.10.13')
    assert machine.run('run').returncode == 0
    assert (machine.venv / 'setup.stamp').read_text().startswith('3.10 ')


@pytest.mark.parametrize('name', ['python3', 'python3.12'])
def test_no_venv_module(machine, name):
    machine.python(name, version='3.12.1', venv=False)
    assert_hint(machine.run('run'), name, f'sudo apt install {name}-venv')
    assert not machine.venv.exists()


def test_no_pip(machine):
    machine.python(pip=False)
    assert_hint(machine.run('run'), 'without pip', 'sudo apt install python3-pip')


def test_other_platform(machine):
    machine.python()
    (machine.folder / 'bin/uname').unlink()
    machine.program('uname', '#!/usr/bin/env bash\necho Linux aarch64\n')
    assert_hint(machine.run('run'), 'Linux x86_64', 'Linux aarch64', 'Jazzy')


def test_no_network(machine):
    machine.python()
    machine.pip('exit 1', 'WARNING: Retrying after NewConnectionError(...)\nERROR: No match')
    assert_hint(machine.run('run'), 'no network', str(machine.venv / 'setup.log'))
    machine.pip('')
    assert machine.run('run').returncode == 0


def test_failing_installation_is_explained_by_its_last_error(machine):
    machine.python()
    machine.pip('exit 1', 'ERROR: the reason\nnote: more of it')
    assert_hint(machine.run('run'), 'ERROR: the reason', str(machine.venv / 'setup.log'))


def test_disk_full(machine):
    machine.python()
    machine.pip('exit 1', 'ERROR: [Errno 28] No space left on device')
    assert_hint(machine.run('run'), 'no space left')


@pytest.mark.skipif(os.geteuid() == 0, reason='root may write everywhere')
def test_project_not_writable(machine):
    machine.python()
    machine.project.chmod(0o555)
    try:
        assert_hint(machine.run('run'), 'cannot write to')
    finally:
        machine.project.chmod(0o755)


def test_environment_of_someone_else_is_left_alone(machine):
    machine.python()
    machine.venv.mkdir()
    (machine.venv / 'precious').touch()
    assert_hint(machine.run('run'), str(machine.venv), 'move it away')
    assert (machine.venv / 'precious').exists()


# --- The command ---------------------------------------------------------------------------------


def test_without_arguments_the_stationary_scenario_runs(machine):
    machine.python()
    assert arguments(machine.run('run')) == ['run', 'stationary']


def test_arguments_are_passed_on(machine):
    machine.python()
    words = ['autonomous', '--set', 'a b', '', '*']
    assert arguments(machine.run('run', *words)) == words


def test_standard_output_has_only_the_commands_output(machine):
    machine.python()
    process = machine.run('run')
    assert process.output.startswith('<run>')
    assert process.errors == 'Setting up .venv: first time only, about a minute ...\n'


def test_test_script_runs_pytest_with_chosen_plugins(machine):
    machine.python()
    process = machine.run('test', '-k', 'a b')
    assert arguments(process)[:2] == ['-m', 'pytest']
    assert arguments(process)[-2:] == ['-k', 'a b']
    assert variable(process, 'PYTEST_DISABLE_PLUGIN_AUTOLOAD') == '1'
    assert variable(process, 'PWD') == str(machine.project)


# --- Installation --------------------------------------------------------------------------------


def test_later_runs_install_nothing(machine):
    machine.python()
    machine.run('run')
    before = machine.calls
    process = machine.run('run')
    assert process.errors == ''
    assert machine.calls == before
    assert len(before) == 2
    assert before[1].endswith('--editable .[ros,drive,viewer]')


def test_test_script_adds_its_tools_once(machine):
    machine.python()
    machine.run('run')
    machine.run('test')
    machine.run('run')
    machine.run('test')
    assert len(machine.calls) == 3
    assert machine.calls[2].endswith('--editable .[ros,drive,viewer,test]')


@pytest.mark.parametrize('name', ['setup.py', 'pyproject.toml', 'ballbot_ros/parameters/new.py'])
def test_changed_requirements_and_nodes_are_installed(machine, name):
    machine.python()
    machine.run('run')
    (machine.project / name).write_text("    node: ClassVar[str] = 'second'")
    process = machine.run('run')
    assert process.errors == 'Updating .venv ...\n'
    assert [call.split()[1] for call in machine.calls] == ['venv', 'pip', 'pip']
    assert machine.run('run').errors == ''


def test_failed_update_leaves_the_environment_as_it_was(machine):
    machine.python()
    machine.run('run')
    (machine.project / 'setup.py').write_text('second')
    machine.pip('exit 1', 'NewConnectionError')
    assert_hint(machine.run('run'), 'no network')
    (machine.project / 'setup.py').write_text('first')
    assert machine.run('run').errors == ''


def test_other_python_recreates_the_environment(machine):
    machine.python()
    machine.run('run')
    (machine.venv / 'stale').touch()
    machine.python(version='3.12.1')
    shutil.copy(machine.folder / 'bin/python3', machine.venv / 'bin/python')
    machine.run('run')
    assert not (machine.venv / 'stale').exists()


def test_vanished_python_recreates_the_environment(machine):
    machine.python()
    machine.run('run')
    (machine.venv / 'bin/python').unlink()
    (machine.venv / 'bin/python').symlink_to('/nonexistent/python')
    assert machine.run('run').returncode == 0
    assert not (machine.venv / 'bin/python').is_symlink()


def test_moved_project_recreates_the_environment(machine):
    machine.python()
    machine.run('run')
    machine.project = machine.project.rename(machine.folder / 'elsewhere')
    machine.run('run')
    assert [call.split()[1] for call in machine.calls] == ['venv', 'pip'] * 2


def test_missing_command_is_installed_again(machine):
    machine.python()
    machine.run('run')
    (machine.venv / 'bin/ballbot').unlink()
    assert arguments(machine.run('run')) == ['run', 'stationary']


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM, signal.SIGKILL])
def test_interrupted_set_up_is_repeated(machine, number):
    machine.python()
    machine.pip('exec sleep 60')
    process = machine.start('run')
    await_sleep(process)
    os.killpg(process.pid, number)
    process.communicate(timeout=LAST_RESORT_S)
    assert process.returncode in (130, -number)
    machine.pip('')
    assert machine.run('run').returncode == 0
    assert [call.split()[1] for call in machine.calls] == ['venv', 'pip'] * 2


def test_interrupted_update_is_repeated(machine):
    machine.python()
    machine.run('run')
    machine.pip('exec sleep 60')
    process = machine.start('test')
    await_sleep(process)
    os.killpg(process.pid, signal.SIGKILL)
    process.communicate(timeout=LAST_RESORT_S)
    machine.pip('')
    assert machine.run('run').errors == 'Updating .venv ...\n'


def test_scripts_started_at_once_install_once(machine):
    machine.python()
    machine.pip('while [[ ! -e $MACHINE/go ]]; do sleep 0.02; done')
    first = machine.start('run', 'first')
    wait_for(lambda: len(machine.calls) == 2, what='the first installation')
    second = machine.start('run', 'second')
    assert 'Waiting' in second.stderr.readline()
    (machine.folder / 'go').touch()
    for process, word in ((first, '<first>'), (second, '<second>')):
        assert process.communicate(timeout=LAST_RESORT_S)[0].startswith(word)
        assert process.returncode == 0
    assert len(machine.calls) == 2


# --- Other environments --------------------------------------------------------------------------


def test_other_virtual_environment_does_not_leak(machine):
    machine.python()
    other = machine.folder / 'other'
    packages = other / 'lib/python3.12/site-packages'
    (packages / 'ros_rcl.libs').mkdir(parents=True)
    (other / 'pyvenv.cfg').touch()
    process = machine.run(
        'run',
        _ROS_WHEELS_BOOTSTRAP_COMPLETE='1',
        LD_LIBRARY_PATH=f'{other}/lib:/mine:{packages}/ros_rcl.libs',
        PYTHONHOME='/nonexistent',
        VIRTUAL_ENV=str(other),
    )
    assert variable(process, 'LD_LIBRARY_PATH') == '/mine'
    assert variable(process, '_ROS_WHEELS_BOOTSTRAP_COMPLETE') is None
    assert variable(process, 'PYTHONHOME') is None
    assert variable(process, 'VIRTUAL_ENV') is None


def test_activated_environment_is_not_recreated_with_its_own_python(machine):
    machine.python()
    machine.run('run')
    machine.environment['PATH'] = f'{machine.venv}/bin:{machine.environment["PATH"]}'
    (machine.venv / 'setup.stamp').unlink()
    assert machine.run('run').returncode == 0


def test_another_copy_of_the_package_does_not_hide_this_one(machine):
    machine.python()
    installed = machine.folder / 'workspace/install'
    (installed / 'ballbot_ros').mkdir(parents=True)
    process = machine.run('run', PYTHONPATH=f'{installed}:{machine.project}:/mine')
    assert variable(process, 'PYTHONPATH') == f'{machine.project}:/mine'


def sourced(distribution, prefix):
    return {
        'ROS_DISTRO': distribution,
        'ROS_VERSION': '2',
        'AMENT_PREFIX_PATH': f'{prefix}:/opt/ros/{distribution}',
        'PYTHONPATH': f'{prefix}/lib/python:/opt/ros/{distribution}/lib/python:/mine',
        'LD_LIBRARY_PATH': f'/opt/ros/{distribution}/lib:{prefix}/lib',
    }


def test_sourced_jazzy_is_used_in_a_separate_environment(machine):
    machine.python(rclpy=True)
    environment = sourced('jazzy', '/overlay')
    process = machine.run('run', **environment)
    assert process.returncode == 0
    assert (machine.project / '.venv-jazzy/setup.stamp').exists()
    assert not machine.venv.exists()
    assert machine.calls[0].startswith('-m venv --system-site-packages')
    assert machine.calls[1].endswith('--editable .[drive,viewer]')
    assert (machine.project / '.venv-jazzy/constraints.txt').read_text() == 'numpy==1.26.4\n'
    for name, value in environment.items():
        assert variable(process, name) == value
    machine.run('test', **environment)
    assert machine.calls[2].endswith('--editable .[drive,viewer,test]')
    assert machine.run('run', **environment).errors == ''


def test_sourced_jazzy_without_its_rclpy_falls_back_to_the_wheels(machine):
    machine.python(rclpy=False)
    process = machine.run('run', **sourced('jazzy', '/overlay'))
    assert process.errors.startswith('note: ROS_DISTRO is jazzy')
    assert machine.venv.exists()


def test_other_sourced_ros_is_reported_and_not_used(machine):
    machine.python()
    process = machine.run('run', **sourced('humble', '/overlay'), RMW_IMPLEMENTATION='rmw_other')
    notes = process.errors.splitlines()
    assert notes[0].startswith("note: the sourced ROS is 'humble', not jazzy")
    assert notes[1].startswith('note: the ROS 2 wheels lack rmw_other')
    assert variable(process, 'PYTHONPATH') == '/mine'
    for name in ('ROS_DISTRO', 'AMENT_PREFIX_PATH', 'LD_LIBRARY_PATH', 'RMW_IMPLEMENTATION'):
        assert variable(process, name) is None
