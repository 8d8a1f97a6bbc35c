"""`ballbot doctor`: the checks of this machine."""

import contextlib
import dataclasses
import os
import signal
import socket
import subprocess
from pathlib import Path
from types import SimpleNamespace

import pytest
from graph import BALLBOT, environment, state, wait_for

from ballbot_ros.cli import doctor
from ballbot_ros.cli.command import COMMANDS
from ballbot_ros.engine import golden
from ballbot_ros.errors import BallbotError
from ballbot_ros.files import share_directory
from ballbot_ros.nodes.transports import rfcomm
from ballbot_ros.parameters import ViewerParameters
from ballbot_ros.run import machine_checks


def refuse(text, error=BallbotError):
    def check(*_):
        raise error(text)

    return check


@pytest.fixture(autouse=True)
def no_optional_checks(monkeypatch):
    monkeypatch.setattr(doctor, 'OPTIONAL_CHECKS', {})


def test_what_only_some_commands_need_is_a_note(monkeypatch, capsys):
    monkeypatch.setattr(doctor, 'CHECKS', {})
    optional = {
        'viewer': (lambda: 'free', 'view'),
        'browser': (refuse('Chromium not found'), 'render'),
    }
    monkeypatch.setattr(doctor, 'OPTIONAL_CHECKS', optional)
    assert doctor.command.callback() == 0
    assert capsys.readouterr().out == (
        'OK   viewer     free\nNOTE browser    Chromium not found (for render)\n'
    )


@pytest.mark.parametrize(
    ('name', 'path', 'failure'),
    [
        ('browser', '', 'Chromium not found: install it with'),
        ('C', '', 'gcc not found: install it with `apt install gcc`'),
        ('ARM', '', 'arm-none-eabi-gcc not found'),
    ],
)
def test_what_is_missing_for_some_commands_is_named(monkeypatch, name, path, failure):
    monkeypatch.setenv('PATH', path)
    with pytest.raises(BallbotError, match=failure):
        machine_checks.OPTIONAL_CHECKS[name][0]()


def adapter(folder, name, **switches):
    """Make the files by which the system describes an adapter."""
    for kind in ('soft', 'hard'):
        switch = folder / name / 'rfkill1' / kind
        switch.parent.mkdir(parents=True, exist_ok=True)
        switch.write_text(f'{int(switches.get(kind, False))}\n')


def test_bluetooth_adapters_are_described(tmp_path):
    with pytest.raises(BallbotError, match='no Bluetooth adapter found: plug one in'):
        rfcomm.describe_adapters(tmp_path)
    adapter(tmp_path, 'hci0', soft=True)
    (tmp_path / 'hci0:256').mkdir()
    with pytest.raises(BallbotError, match='hci0 is switched off: run `rfkill unblock bluetooth`'):
        rfcomm.describe_adapters(tmp_path)
    adapter(tmp_path, 'hci1')
    assert rfcomm.describe_adapters(tmp_path) == 'hci0, hci1'


def test_a_python_without_bluetooth_is_told_what_else_works(monkeypatch):
    monkeypatch.delattr(socket, 'AF_BLUETOOTH', raising=False)
    with pytest.raises(BallbotError, match=r'no Bluetooth sockets.*rfcomm bind 0.*--port'):
        rfcomm.check_address('00:16:53:01:02:03')
    with pytest.raises(BallbotError, match="'00:16:53' is no Bluetooth address, such as 00:16:53:"):
        rfcomm.check_address('00:16:53')


@pytest.mark.parametrize(
    ('kept', 'told'), [(True, ': ready'), (False, ': compiled at their first use, in about 20 s')]
)
def test_it_says_whether_compiled_code_is_ready(monkeypatch, kept, told):
    pytest.importorskip('numba')
    monkeypatch.setattr(machine_checks, 'has_kept_code', lambda: kept)
    assert machine_checks.OPTIONAL_CHECKS['compiled'][0]() == 'compiled runs by numba' + told


def test_without_numba_it_says_how_to_install_it(monkeypatch):
    monkeypatch.setattr(machine_checks, 'can_compile', lambda: False)
    with pytest.raises(BallbotError, match='numba not found: pip install'):
        machine_checks.OPTIONAL_CHECKS['compiled'][0]()


def test_a_taken_port_of_the_viewer_is_named(monkeypatch):
    with socket.create_server(('127.0.0.1', 0)) as taken:
        parameters = ViewerParameters(port=taken.getsockname()[1])
        monkeypatch.setattr(
            machine_checks, 'ParameterSet', lambda: SimpleNamespace(of=lambda _: parameters)
        )
        with pytest.raises(BallbotError, match=f'{parameters.port}: Address already in use'):
            machine_checks.OPTIONAL_CHECKS['viewer'][0]()


def test_every_optional_check_names_the_commands():
    for _, line in machine_checks.OPTIONAL_CHECKS.values():
        for words in line.split(', '):
            assert words.split()[0] in COMMANDS or words.startswith('--controller')


@pytest.fixture
def only_arithmetic(monkeypatch):
    monkeypatch.setattr(doctor, 'CHECKS', {'arithmetic': machine_checks._arithmetic})


def test_a_machine_with_the_golden_hashes_passes(only_arithmetic, capsys):
    assert doctor.command.callback() == 0
    assert capsys.readouterr().out == (
        'OK   arithmetic stationary and hardware_autonomous have the same duty_sha256 '
        'as on every machine\n'
    )


@pytest.mark.parametrize(
    ('changes', 'named'),
    [
        ({'arithmetic': '0123456789'}, 'the arithmetic has the hash '),
        ({'scenarios': {'stationary': '0123456789'}}, 'the scenario stationary has the hash '),
    ],
)
def test_a_machine_with_another_hash_fails_with_both_hashes(
    only_arithmetic, monkeypatch, capsys, changes, named
):
    wrong = dataclasses.replace(golden.load_golden(), **changes)
    monkeypatch.setattr(machine_checks, 'load_golden', lambda: wrong)
    assert doctor.command.callback() == 1
    [line] = capsys.readouterr().out.splitlines()
    assert line.startswith(f'FAIL arithmetic {named}')
    assert 'here, but 01234567… on other machines' in line


@pytest.mark.parametrize('text', [None, '', 'scenarios: 3', '{', 'arithmetic: x'])
def test_a_missing_or_damaged_golden_file_is_one_line(
    only_arithmetic, monkeypatch, capsys, tmp_path, text
):
    if text is not None:
        (tmp_path / 'config').mkdir()
        (tmp_path / golden.GOLDEN_FILE).write_text(text)
    monkeypatch.setattr(golden, 'share_directory', lambda: tmp_path)
    with pytest.raises(BallbotError, match='missing or damaged'):
        golden.load_golden()
    assert doctor.command.callback() == 1
    [line] = capsys.readouterr().out.splitlines()
    assert line.endswith('golden.yaml: missing or damaged')


def test_a_sine_of_the_c_library_is_noticed(monkeypatch):
    """It needs its own hash: the duties of a scenario may stay the same if its last bits differ."""
    import math

    before = golden.arithmetic_sha256()
    monkeypatch.setattr(golden, 'sine_cosine', lambda angle: (math.sin(angle), math.cos(angle)))
    assert golden.arithmetic_sha256() != before == golden.load_golden().arithmetic


def test_a_name_in_brackets_is_printed_as_it_is(monkeypatch, capsys):
    checks = {'files': lambda: '/tmp/[red]', 'disk': refuse('/tmp/[/x] is full')}
    monkeypatch.setattr(doctor, 'CHECKS', checks)
    assert doctor.command.callback() == 1
    assert (
        capsys.readouterr().out == 'OK   files      /tmp/[red]\nFAIL disk       /tmp/[/x] is full\n'
    )


def test_what_is_missing_is_named_with_advice(monkeypatch):
    """Each row is a check, the function that it calls and its replacement, and the failure."""
    rmw = 'rclpy.utilities.get_rmw_implementation_identifier'
    here = 'ballbot_ros.run.machine_checks'
    unloadable = refuse('no\nlibrary', RuntimeError)
    for check, replaced, stub, rmw_name, failure in (
        ('_python', f'{here}.MIN_PYTHON', (99, 0), '', 'is too old: install Python 3.10 or later'),
        ('_files', f'{here}.share_directory', refuse('no files'), '',
         '^no files: reinstall the package$'),
        ('_rclpy', f'{here}.find_spec', lambda name: None, '', '^rclpy not found: source ROS 2'),
        ('_rclpy', f'{here}.find_spec', lambda name: SimpleNamespace(origin=None), '',
         '^rclpy not found'),
        ('_rmw', f'{here}.require_middleware', refuse('it is missing'), '', '^it is missing$'),
        ('_rmw', rmw, unloadable, 'rmw_x', r'unset RMW_IMPLEMENTATION \(rmw_x\) \(no library\)$'),
        ('_rmw', rmw, unloadable, '', r'install rmw_fastrtps_cpp \(no library\)$'),
        ('_domain', f'{here}.require_discovery', refuse('it is off'), '', '^it is off$'),
    ):  # fmt: skip
        if replaced == rmw:
            pytest.importorskip('rclpy')
        with monkeypatch.context() as patch:
            patch.setattr(f'{here}.require_middleware', lambda: None)
            patch.setattr(replaced, stub)
            patch.setenv('RMW_IMPLEMENTATION', rmw_name)
            with pytest.raises(BallbotError, match=failure):
                getattr(machine_checks, check)()


def test_what_is_found_is_named(monkeypatch):
    monkeypatch.setenv('ROS_DOMAIN_ID', '7')
    monkeypatch.delenv('ROS_AUTOMATIC_DISCOVERY_RANGE')
    domain = machine_checks._domain()
    assert domain.startswith('ROS_DOMAIN_ID 7, ROS_AUTOMATIC_DISCOVERY_RANGE not set: ')
    monkeypatch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'SUBNET')
    assert machine_checks._domain().endswith('_RANGE SUBNET')
    assert machine_checks._files() == str(share_directory())
    origin = SimpleNamespace(origin='/opt/rclpy/__init__.py')
    monkeypatch.setattr(machine_checks, 'find_spec', lambda name: origin)
    assert machine_checks._rclpy() == '/opt/rclpy'


@pytest.fixture
def discovery_port(monkeypatch):
    """A socket with the port of discovery in a ROS domain of its own."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        other.bind(('', 0))
        monkeypatch.setattr(machine_checks, 'PORT_BASE', other.getsockname()[1])
        monkeypatch.setattr(machine_checks, 'ros_domain', lambda: 0)
        yield other


def test_a_port_is_shared_with_nodes_but_not_with_another_program(discovery_port):
    assert 'are free for discovery' in machine_checks._ports()
    discovery_port.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 0)
    with pytest.raises(BallbotError, match=': Address already in use: use another ROS_DOMAIN_ID'):
        machine_checks._ports()


def test_recordings_need_a_folder_and_room(monkeypatch, tmp_path, capsys):
    """Each row is the folders so far, whether they are writable, the free space, and the result."""
    disk = SimpleNamespace()
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(machine_checks.os, 'access', lambda *_: disk.is_writable)
    monkeypatch.setattr(machine_checks.shutil, 'disk_usage', lambda _: disk)
    monkeypatch.setattr(doctor, 'CHECKS', {'disk': machine_checks._disk})
    runs = tmp_path / 'runs'
    for folder, disk.is_writable, disk.free, status in (
        (tmp_path, True, 200e6, 0),
        (tmp_path, True, 199e6, 1),
        (tmp_path, False, 2e9, 1),
        (runs, True, 2e9, 0),
        (runs, False, 2e9, 1),
    ):
        folder.mkdir(exist_ok=True)
        assert doctor.command.callback() == status, vars(disk)
        assert str(folder) in capsys.readouterr().out or disk.free < 200e6


def test_discovery_works_only_if_its_process_says_so(monkeypatch):
    """Each row is the status of the process, its output, and the result of the check."""
    monkeypatch.setattr(machine_checks.subprocess, 'Popen', Probe)
    for status, output, failure in (
        (0, 'found in 0.1 s\n', ''),
        (0, 'Fast DDS: a port is taken\nfound in 0.1 s\n', ''),
        (1, 'no\nnodes\n', 'no nodes'),
        (-signal.SIGALRM, '', 'the middleware did not respond within '),
        (-signal.SIGSEGV, '', f'ended with {-signal.SIGSEGV}'),
    ):
        Probe.returncode, Probe.output = status, output
        if failure:
            with pytest.raises(BallbotError, match=failure):
                machine_checks._discovery()
        else:
            assert machine_checks._discovery() == 'found in 0.1 s'


class Probe:
    """The process of a check that has ended."""

    def __init__(self, command, **options):
        pass

    def communicate(self):
        return self.output, None

    def kill(self):
        pass

    def wait(self):
        pass


@pytest.mark.graph
def test_the_command_ends_on_sigint_while_the_middleware_hangs(domain):
    with subprocess.Popen(
        [*BALLBOT, 'doctor'],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment(domain),
    ) as process:  # fmt: skip
        children = Path(f'/proc/{process.pid}/task/{process.pid}/children')
        [child] = wait_for(lambda: discovery_processes(children), what='the check of discovery')
        os.kill(int(child.name), signal.SIGSTOP)
        # Wait until the command sleeps: on a busy machine it may not yet have stored the process
        # that it has started.
        wait_for(lambda: state(process.pid) == 'S', what='that it waits for the check')
        process.send_signal(signal.SIGINT)
        output, errors = process.communicate()
    assert output.splitlines()[-1].startswith('OK   ports')
    assert process.returncode == 128 + signal.SIGINT
    assert 'Traceback' not in errors
    assert not child.exists()


def discovery_processes(children):
    """Return the processes that have begun the check of discovery."""
    found = []
    for process in children.read_text().split():
        with contextlib.suppress(FileNotFoundError):  # that of another check, which has ended
            if b'discovery_probe' in Path('/proc', process, 'cmdline').read_bytes():
                found.append(Path('/proc', process))
    return found


@pytest.mark.graph
def test_the_command_makes_every_check(domain):
    done = subprocess.run(
        [*BALLBOT, 'doctor'],
        capture_output=True, text=True, env=environment(domain), check=False,
    )  # fmt: skip
    lines = done.stdout.splitlines()
    names = [*doctor.CHECKS, *machine_checks.OPTIONAL_CHECKS]
    assert [line.split()[1] for line in lines] == names, done.stdout + done.stderr
    assert done.returncode == 0, done.stdout
