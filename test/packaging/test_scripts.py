"""The scripts on a simulated machine: no network, no real interpreter."""

import json
import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest
from graph import LAST_RESORT_S, wait_for
from terminal import Terminal

ROOT = Path(__file__).resolve().parents[2]
TOOLS = (
    'bash', 'basename', 'cat', 'cp', 'dirname', 'flock', 'grep', 'ln', 'mkdir', 'readlink',
    'realpath', 'rm', 'tail',
)  # fmt: skip
INTERPRETER = Path(sys.executable).resolve()
PRINT = 'import json, os, sys; print(json.dumps([sys.argv[1:], dict(os.environ)]))'

# An interpreter of some version, with some modules. It is also the interpreter of the environments
# that it creates.
PYTHON = f"""#!{INTERPRETER} -IS
import os, sys, time

def write(mode, name, *lines):
    with open(name, mode) as file:
        print(*lines, sep='\\n', file=file)
    os.chmod(name, 0o755)

machine = os.environ['MACHINE']
if {{'venv', 'pip'}} & {{*sys.argv}}:
    write('a', machine + '/calls', ' '.join(sys.argv[2:]))
match sys.argv[1:]:
    case ['-V']:
        print('Python', *VERSION)
    case ['-c', code]:
        sys.version_info = VERSION
        for name in 'ensurepip', 'numpy', 'rclpy':
            sys.modules[name] = sys if name in MODULES else None
        sys.__version__ = '1.26.4'
        exec(code)
    case ['-m', 'venv', *_, env]:
        os.mkdir(env + '/bin')
        write('w', env + '/bin/python', open(__file__).read())
        write('w', env + '/bin/pip', '#!/bin/sh', f'"{{env}}/bin/python" && echo in "{{env}}/lib"')
    case ['-m', 'pip', *_]:
        exec(open(machine + '/pip').read())
        program = "'''", 'from ballbot_ros.cli.main import main', "'''", '{PRINT}'
        write('w', os.path.dirname(__file__) + '/ballbot', '#!{INTERPRETER} -IS', *program)
    case ['-m', 'ballbot_ros.cli.installation', *_]:
        import runpy
        sys.path.insert(0, '{ROOT}')
        sys.executable, sys.argv = __file__, sys.argv[2:]
        runpy.run_module('ballbot_ros.cli.installation', run_name='__main__')
    case ['-m', 'pytest', *_]:
        {PRINT}
    case ['-m', 'sphinx', *_]:
        exec(open(machine + '/sphinx').read())
    case [script, folder] if script.endswith('docs/playground/build.py'):
        write('w', machine + '/playground', folder)
    case [script, *_] if script.endswith('docs/playground/serve.py'):
        {PRINT}
    case ['-m', 'jupyter' | 'benchmark.bench', *_]:
        {PRINT}
"""


class Machine:
    """A machine with a project, some tools and the interpreters added to it."""

    def __init__(self, folder):
        self.folder = folder
        self.project = folder / 'my project'
        self.venv = self.project / '.venv'
        self.environment = {'PATH': str(folder / 'bin'), 'MACHINE': str(folder), 'CI': 'true'}
        (folder / 'bin').mkdir()
        for tool in TOOLS:
            (folder / 'bin' / tool).symlink_to(shutil.which(tool))
        for folder in ('scripts', 'launch'):
            shutil.copytree(ROOT / folder, self.project / folder)
        (self.project / 'ballbot_ros/parameters').mkdir(parents=True)
        for name in ('setup.py', 'pyproject.toml', 'ballbot_ros/parameters/nodes.py'):
            (self.project / name).write_text("node: ClassVar[str] = 'first'")
        self.pip('')
        self.sphinx(PRINT)

    def python(self, name='python3', version=(3, 11, 2), modules=('ensurepip',)):
        file = self.folder / 'bin' / name
        file.write_text(PYTHON.replace('VERSION', str(version)).replace('MODULES', str(modules)))
        file.chmod(0o755)

    def pip(self, code):
        """Let pip do this when it installs."""
        (self.folder / 'pip').write_text(code)

    def sphinx(self, code):
        """Let Sphinx do this when it builds the site."""
        (self.folder / 'sphinx').write_text(code)

    def calls(self):
        """Return the calls of venv and pip since the last time."""
        calls = self.folder / 'calls'
        lines = calls.read_text().splitlines() if calls.exists() else []
        calls.unlink(missing_ok=True)
        return lines

    def programs_called(self):
        return [call.split()[0] for call in self.calls()]

    def start(self, script, *arguments, cwd=None, **environment):
        return subprocess.Popen(
            [self.project / 'scripts' / script, *arguments],
            cwd=cwd,
            env=self.environment | environment,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
        )

    def run(self, script, *arguments, **environment):
        """Run a script; return the arguments and environment of its command, and the messages."""
        return result(self.start(script, *arguments, **environment))

    def refusal(self, script='run', *arguments, **environment):
        """Return the line with which a script fails; only lines of progress precede it."""
        process = self.start(script, *arguments, **environment)
        output, messages = process.communicate(timeout=LAST_RESORT_S)
        assert (process.returncode, output) == (2, ''), messages
        *progress, hint = messages.splitlines()
        assert all(line.startswith('Setting up ') for line in progress)
        return hint


def result(process):
    output, messages = process.communicate(timeout=LAST_RESORT_S)
    assert process.returncode == 0, messages
    arguments, environment = json.loads(output)
    return SimpleNamespace(arguments=arguments, environment=environment, messages=messages)


@pytest.fixture
def bare_machine(tmp_path):
    return Machine(tmp_path)


@pytest.fixture
def machine(bare_machine):
    bare_machine.python()
    return bare_machine


# --- Missing requirements ------------------------------------------------------------------------


def test_a_machine_without_a_supported_python_gets_a_hint(bare_machine):
    machine = bare_machine
    unsupported = [{'version': (3, 9, 18)}, {'version': (3, 14, 0)}, {'modules': ()}]
    hints = [machine.refusal()]
    for python in unsupported:
        machine.python(**python)
        hints.append(machine.refusal())
    assert set(hints) == {
        'run: found no Python 3.10 to 3.13 that imports ensurepip: sudo apt install python3-venv'
    }


def test_the_scripts_use_another_python_if_the_first_does_not_qualify(bare_machine):
    bare_machine.python(version=(3, 9, 18))
    bare_machine.python('python3.12', version=(3, 12, 1), modules=())
    bare_machine.python('python3.10', version=(3, 10, 13))
    bare_machine.run('run')
    assert (bare_machine.venv / 'run.stamp').read_text().startswith('Python 3 10 13 in ')


def test_a_failed_installation_is_explained_and_repeated(machine):
    machine.pip("sys.exit('noise\\nERROR: nothing at ' + os.environ['PIP_INDEX_URL'] + '\\nnote')")
    hint = machine.refusal(PIP_INDEX_URL='http://nowhere')
    assert '(no network?): ERROR: nothing at http://nowhere (details in ' in hint
    assert hint.endswith(f'{machine.venv}/setup.log)')
    machine.pip('')
    machine.run('run')
    assert machine.programs_called() == ['venv', 'pip'] * 2


def test_ctrl_c_during_the_installation_is_no_failure_of_it(machine):
    # pip catches the interrupt, and ends with a status of its own.
    machine.pip(
        "write('w', machine + '/installs')\n"
        'try:\n    time.sleep(600)\n'
        "except KeyboardInterrupt:\n    sys.exit('ERROR: Operation cancelled by user')"
    )
    process = machine.start('run')
    wait_for((machine.folder / 'installs').exists, what='the installation')
    os.killpg(process.pid, signal.SIGINT)
    output, messages = process.communicate(timeout=LAST_RESORT_S)
    assert (process.returncode, output) == (130, '')
    assert [line for line in messages.splitlines() if line] == [messages.splitlines()[0]]
    machine.pip('')
    machine.run('run')


def test_the_scripts_leave_the_environment_of_someone_else_alone(machine):
    machine.venv.mkdir()
    (machine.venv / 'precious').touch()
    assert machine.refusal().endswith(f'{machine.venv} was not made by these scripts: move it away')
    assert (machine.venv / 'precious').exists()


# --- The command ---------------------------------------------------------------------------------


def test_run_passes_its_arguments_to_the_command(machine):
    assert machine.run('run').arguments == ['run', 'stationary']
    words = ['autonomous', '--set', 'a b', '', '*']
    assert machine.run('run', *words).arguments == words


def reader_of(script):
    """Return the process ID of the only child of a script."""
    (child,) = Path(f'/proc/{script.pid}/task/{script.pid}/children').read_text().split()
    return int(child)


def catches(process, number):
    """Return whether a process has a handler of its own for a signal."""
    status = dict(
        line.split(':', 1) for line in Path(f'/proc/{process}/status').read_text().splitlines()
    )
    return bool(int(status['SigCgt'], 16) & 1 << number - 1)


def test_a_first_run_at_a_terminal_with_a_browser_offers_to_watch_it(machine, monkeypatch):
    for day in ('2026-01-01', '2026-01-02'):
        recording = machine.folder / f'runs/{day}_stationary/stationary.mcap'
        recording.parent.mkdir(parents=True)
        recording.touch()
    words = [machine.project / 'scripts/run']
    monkeypatch.chdir(machine.folder)
    terminal = Terminal()
    process = terminal.start(words, **machine.environment, BROWSER='any')
    terminal.wait_for_text(b'Enter: watch it in 3D')
    terminal.press(b'\n')
    terminal.wait_for_text(b'[["view", "runs/2026-01-02_stationary/stationary.mcap"]')
    assert process.wait(LAST_RESORT_S) == 0
    process = terminal.start(words, **machine.environment)
    assert process.wait(LAST_RESORT_S) == 0
    terminal = Terminal()
    process = terminal.start(words, **machine.environment, BROWSER='any')
    terminal.wait_for_text(b'Enter: watch it in 3D')
    assert not catches(reader_of(process), signal.SIGINT)  # it dies of one at any moment
    terminal.press(b'\x03')
    assert process.wait(LAST_RESORT_S) == 0


def test_the_test_script_runs_pytest_with_chosen_plugins(machine):
    run = machine.run('test', '-k', 'a b')
    assert run.arguments[:2] == ['-m', 'pytest']
    assert run.arguments[-2:] == ['-k', 'a b']
    assert run.environment['PYTEST_DISABLE_PLUGIN_AUTOLOAD'] == '1'
    assert run.environment['PWD'] == str(machine.project)


def test_the_docs_script_builds_from_nothing_with_warnings_as_errors(machine):
    old = [
        machine.project / 'docs/_build/html/old.html',
        machine.project / 'docs/api/packages/old.rst',
    ]
    for file in old:
        file.parent.mkdir(parents=True)
        file.touch()
    output, messages = machine.start('docs').communicate(timeout=LAST_RESORT_S)
    page, hint = output.splitlines()
    assert page == f'{machine.project}/docs/_build/html/index.html', messages
    assert hint.endswith('http://localhost:8000/playground/')
    assert (machine.folder / 'playground').read_text() == 'docs/_build/html/playground\n'
    arguments, environment = json.loads((machine.project / 'docs/_build/build.log').read_text())
    assert arguments[:3] == ['-m', 'sphinx', '--fail-on-warning']
    assert environment['PWD'] == str(machine.project)
    assert not any(file.exists() for file in old)


def test_the_playground_script_builds_the_page_and_serves_it(machine):
    page = f'{machine.project}/docs/_build/playground'
    assert machine.run('playground').arguments[1:] == [page]
    assert (machine.folder / 'playground').read_text() == f'{page}\n'


def test_a_failed_build_of_the_site_shows_its_log(machine):
    machine.run('run')
    machine.sphinx('sys.exit("docs/drive.md:3: WARNING: target not found")')
    process = machine.start('docs')
    output, messages = process.communicate(timeout=LAST_RESORT_S)
    assert (process.returncode, output) == (1, '')
    assert messages.endswith('docs/drive.md:3: WARNING: target not found\n')


def test_the_notebook_script_opens_markdown_as_notebooks(machine):
    run = machine.run('notebook', '--no-browser')
    folder = str(machine.project / 'docs/notebooks')
    assert run.arguments == ['-m', 'jupyter', 'lab', '--notebook-dir', folder, '--no-browser']
    assert (
        machine.calls()[-1]
        == 'pip install --no-input --no-compile -e .[ros,drive,viewer,gym,mpc,all,notebook]'
    )
    (settings,) = (machine.project / '.venv').rglob('overrides.json')
    assert 'Jupytext Notebook' in str(json.loads(settings.read_text()))


def test_the_benchmark_has_the_packages_of_all_its_parts_and_its_help_needs_none(machine):
    for words, extra in (['--help'], ''), ([], ',all,cluster'):
        assert machine.run('bench', *words).arguments == ['-m', 'benchmark.bench', *words]
        assert (
            machine.calls()[-1]
            == f'pip install --no-input --no-compile -e .[ros,drive,viewer,gym,mpc{extra}]'
        )


# --- ros2 ----------------------------------------------------------------------------------------

INSTALL_ROS2 = f"""
if '--prefix' in sys.argv:
    prefix = sys.argv[sys.argv.index('--prefix') + 1]
    for folder in 'bin', 'lib/python3.11/site-packages':
        os.makedirs(prefix + '/' + folder, exist_ok=True)
    write('w', prefix + '/bin/ros2', '#!{INTERPRETER} -IS', {PRINT!r})
"""


@pytest.fixture
def sources(tmp_path):
    """Return a folder with copies of the repositories that scripts/ros2 installs."""
    script = (ROOT / 'scripts/ros2').read_text()
    code = script[script.index('packages=(') : script.index('# What they need')]
    code += 'printf "%s\n" "${packages[@]}"'
    listing = subprocess.run(['bash', '-c', code], check=True, capture_output=True, text=True)
    for package in listing.stdout.split():
        (tmp_path / 'copies' / package).mkdir(parents=True)
        (tmp_path / 'copies' / package / 'setup.py').touch()
    return tmp_path / 'copies'


def test_ros2_is_installed_once_from_a_copy_and_finds_the_package(machine, sources):
    machine.pip(INSTALL_ROS2)
    run = machine.run('ros2', 'topic', 'list', BALLBOT_ROS2_SOURCES=str(sources))
    assert run.arguments == ['topic', 'list']
    prefix = machine.venv / 'ros2'
    assert run.environment['AMENT_PREFIX_PATH'] == f'{machine.venv}:{prefix}'
    assert run.environment['PYTHONPATH'].split(':') == [
        str(machine.project),
        str(prefix / 'lib/python3.11/site-packages'),
    ]
    installations = machine.calls()[-2:]
    assert all(f' --prefix {prefix} ' in call for call in installations)
    assert ' ./ros2cli/ros2topic ' in installations[1]
    # Neither built in place nor installed again.
    assert {file.name for file in sources.rglob('*') if file.is_file()} == {'setup.py'}
    assert machine.run('ros2').messages == ''
    assert machine.calls() == []


def test_what_ros2_can_not_be_installed_from_is_explained(machine, sources):
    environment = {'BALLBOT_ROS2_SOURCES': 'copies'}  # relative to the folder of the caller
    (sources / 'launch_ros/ros2launch/setup.py').unlink()
    hint = machine.refusal('ros2', **environment, cwd=sources.parent)
    assert hint.startswith(f'ros2: {sources}/launch_ros/ros2launch/setup.py not found: ')
    # There is no git either.
    hint = machine.refusal('ros2')
    assert hint.startswith('ros2: cannot fetch ros2/ros2cli from github.com (no network?): ')
    assert hint.endswith(f'(details in {machine.venv}/ros2.log)')
    assert machine.refusal('ros2', 'bag', 'info').startswith('ros2: bag needs compiled packages')


def test_a_sourced_jazzy_brings_its_own_ros2(bare_machine):
    machine, jazzy = bare_machine, sourced('jazzy')
    machine.python(modules=('ensurepip', 'numpy', 'rclpy'))
    hint = machine.refusal('ros2', **jazzy)
    assert hint == 'ros2: the sourced ROS has no ros2: sudo apt install ros-jazzy-ros-base'
    program = machine.folder / 'bin/ros2'
    program.write_text(f'#!{INTERPRETER} -IS\n{PRINT}')
    program.chmod(0o755)
    run = machine.run('ros2', 'bag', 'info', **jazzy)
    assert run.arguments == ['bag', 'info']
    assert run.environment['AMENT_PREFIX_PATH'] == f'{machine.venv}-jazzy:/opt/ros/jazzy'


# --- Installation --------------------------------------------------------------------------------


def test_each_script_installs_what_it_needs_once(machine):
    assert machine.run('run').messages.startswith('Setting up .venv')
    venv, pip = machine.calls()
    assert venv == f'venv {machine.venv}'
    assert pip == 'pip install --no-input --no-compile -e .[ros,drive,viewer,gym,mpc]'
    machine.run('test')
    assert machine.calls() == [
        'pip install --no-input --no-compile -e .[ros,drive,viewer,gym,mpc,all,test]'
    ]
    machine.start('docs').communicate(timeout=LAST_RESORT_S)
    assert machine.calls() == [
        'pip install --no-input --no-compile -e .[ros,drive,viewer,gym,mpc,all,docs]'
    ]
    assert machine.run('run').messages == machine.run('test').messages == ''
    assert machine.calls() == []


def test_changed_requirements_and_nodes_update_the_environment(machine):
    machine.run('test')
    machine.calls()
    for name in ('setup.py', 'pyproject.toml', 'ballbot_ros/parameters/new.py'):
        (machine.project / name).write_text("    node: ClassVar[str] = 'second'")
        machine.run('run')
        assert machine.calls() == [
            'pip install --no-input --no-compile -e .[ros,drive,viewer,gym,mpc]'
        ], name
    machine.run('test')
    assert machine.calls() == [
        'pip install --no-input --no-compile -e .[ros,drive,viewer,gym,mpc,all,test]'
    ]


def test_ros2_finds_the_package_in_the_environment(machine):
    machine.run('run')
    links = {
        'share/ament_index/resource_index/packages/ballbot_ros': machine.project
        / 'resource/ballbot_ros',
        'share/ballbot_ros/package.xml': machine.project / 'package.xml',
        'share/ballbot_ros/launch/ballbot.launch.py': machine.project / 'launch/ballbot.launch.py',
        'lib/ballbot_ros/ballbot': machine.venv / 'bin/ballbot',
    }
    assert {name: (machine.venv / name).readlink() for name in links} == links
    assert len(list((machine.venv / 'lib/ballbot_ros').iterdir())) == 1

    (machine.project / 'launch/new.launch.py').touch()
    (machine.venv / 'lib/ballbot_ros/former_node').touch()
    machine.run('run')
    assert (machine.venv / 'share/ballbot_ros/launch/new.launch.py').exists()
    assert not (machine.venv / 'lib/ballbot_ros/former_node').exists()


def test_a_failed_update_leaves_the_environment_as_it_was(machine):
    machine.run('run')
    (machine.project / 'setup.py').write_text('second')
    machine.pip('sys.exit(1)')
    machine.refusal()
    (machine.project / 'setup.py').write_text("node: ClassVar[str] = 'first'")
    assert machine.run('run').messages == ''


def replace_python(machine):
    """Act as a system that has upgraded the interpreter under the environment."""
    (machine.venv / 'bin/python').unlink()


def move_project(machine):
    machine.project = machine.project.rename(machine.folder / 'elsewhere')
    machine.venv = machine.project / '.venv'


def activate(machine):
    """Put the environment first on PATH, and make it unusable."""
    machine.environment['PATH'] = f'{machine.venv}/bin:{machine.environment["PATH"]}'
    shutil.copy(machine.venv / 'bin/python', machine.venv / 'bin/python3')
    (machine.venv / 'run.stamp').unlink()


@pytest.mark.parametrize('break_it', [replace_python, move_project, activate])
def test_an_unusable_environment_is_created_again(machine, break_it):
    machine.run('run')
    machine.calls()
    break_it(machine)
    (machine.venv / 'stale').touch()
    machine.run('run')
    assert machine.programs_called() == ['venv', 'pip']
    assert not (machine.venv / 'stale').exists()
    assert machine.run('run').messages == ''


def test_a_killed_set_up_is_repeated(machine):
    machine.pip("write('w', machine + '/started'); time.sleep(60)")
    process = machine.start('run')
    wait_for((machine.folder / 'started').exists, what='the installation')
    os.killpg(process.pid, signal.SIGKILL)
    process.communicate(timeout=LAST_RESORT_S)
    machine.pip('')
    machine.run('run')
    assert machine.programs_called() == ['venv', 'pip'] * 2


def test_scripts_that_start_at_once_install_once(machine):
    machine.pip("while not os.path.exists(machine + '/go'): time.sleep(0.02)")
    processes = [machine.start('run', word) for word in ('first', 'second')]
    for process in processes:
        assert process.stderr.readline().startswith('Setting up .venv')
    (machine.folder / 'go').touch()
    assert [result(process).arguments for process in processes] == [['first'], ['second']]
    assert machine.programs_called() == ['venv', 'pip']


# --- A sourced ROS -------------------------------------------------------------------------------


def sourced(distribution):
    prefix = f'/opt/ros/{distribution}'
    return {
        'ROS_DISTRO': distribution,
        'AMENT_PREFIX_PATH': prefix,
        'PYTHONPATH': f'{prefix}/lib/python',
        'LD_LIBRARY_PATH': f'{prefix}/lib',
    }


def test_this_source_tree_hides_an_installed_copy(machine):
    environment = machine.run('run', PYTHONPATH='/workspace/install').environment
    assert environment['PYTHONPATH'] == f'{machine.project}:/workspace/install'


def test_a_sourced_jazzy_gets_an_environment_without_the_wheels(bare_machine):
    machine, jazzy = bare_machine, sourced('jazzy')
    machine.python()
    machine.python('python3.12', (3, 12, 3), ('ensurepip', 'numpy', 'rclpy'))
    environment = machine.run('run', **jazzy).environment
    assert machine.calls() == [
        f'venv --system-site-packages {machine.venv}-jazzy',
        'pip install --no-input --no-compile -e .[drive,viewer,gym,mpc] numpy==1.26.4',
    ]
    jazzy['PYTHONPATH'] = f'{machine.project}:{jazzy["PYTHONPATH"]}'
    assert environment.items() >= jazzy.items()
    assert machine.run('run', **jazzy).messages == ''
    assert not machine.venv.exists()


def test_a_sourced_jazzy_without_its_rclpy_gets_a_hint(machine):
    assert 'that imports ensurepip,numpy,rclpy' in machine.refusal(**sourced('jazzy'))


def test_another_sourced_ros_is_reported_and_not_used(machine):
    run = machine.run('run', **sourced('humble'))
    assert run.messages.startswith('note: the sourced ROS is humble, not jazzy')
    assert run.environment['PYTHONPATH'] == str(machine.project)
    assert not run.environment.keys() & {'ROS_DISTRO', 'AMENT_PREFIX_PATH', 'LD_LIBRARY_PATH'}
