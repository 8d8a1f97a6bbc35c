"""Nodes as forks of one process: each is like a process of its own."""

import contextlib
import json
import os
import signal
import socket
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest
from graph import LAST_RESORT_S, alive, wait_for

from campaign.site import children

pytest.importorskip('rclpy')

from ballbot_ros.errors import BallbotError
from ballbot_ros.nodes.fork_server import NodeRequest
from ballbot_ros.nodes.middleware import LOCK_FD_ENV, DomainLock
from ballbot_ros.run import node_process as fork_client
from ballbot_ros.run.node_process import ForkClient

pytestmark = pytest.mark.graph


class Nodes:
    """Nodes of a fork client, with their output in files."""

    def __init__(self, client, folder, domain):
        self.client, self._folder = client, folder
        self._environment = {**os.environ, 'ROS_DOMAIN_ID': str(domain)}
        self._started = []

    def start(self, name, *arguments, inherited=None, **environment):
        with self.output_of(name).open('wb') as output:
            variables = self._environment | environment
            inherited = inherited or {}
            request = NodeRequest(name, [name, *arguments], variables, [*inherited])
            files = list(inherited.values())
            self._started.append(self.client.start(request, output.fileno(), files))
        return self._started[-1]

    def end(self):
        for process in self._started:
            if self.client.status_of(process) is None:
                os.kill(process, signal.SIGKILL)
                self.client.await_end(process, LAST_RESORT_S)

    def output_of(self, name):
        return self._folder / f'{name}.txt'

    def await_start(self, name):
        wait_for(lambda: 'started' in self.output_of(name).read_text(), what=f'start of {name}')


@pytest.fixture
def nodes(fork_client, tmp_path, domain):
    nodes = Nodes(fork_client, tmp_path, domain)
    yield nodes
    nodes.end()


def field(process, name):
    lines = Path(f'/proc/{process}/status').read_text().splitlines()
    return next(line.split()[1] for line in lines if line.startswith(f'{name}:'))


def test_each_node_is_a_process_of_its_own_name_session_and_environment(nodes):
    folder = ('--ros-args', '--log-level', 'INFO')
    running = {name: nodes.start(name, *folder) for name in ('gyro_driver', 'encoder_driver')}
    for name, process in running.items():
        nodes.await_start(name)
        line = Path(f'/proc/{process}/cmdline').read_text()
        assert line.rstrip('\0').split('\0') == [name, *folder]
        assert field(process, 'Name') == name
        assert os.getsid(process) == process
        assert str(Path(f'/proc/{process}/fd/0').readlink()) == os.devnull
        assert nodes.client.status_of(process) is None
    assert len(set(running.values())) == 2
    # Nothing of one node is open in another, such as its output.
    for name, process in running.items():
        files = [str(each.readlink()) for each in Path(f'/proc/{process}/fd').iterdir()]
        assert [file for file in files if file.endswith('.txt')] == [str(nodes.output_of(name))] * 2


def test_a_long_command_line_is_cut_off_and_leaves_the_environment_alone(nodes):
    process = nodes.start('gyro_driver', '--ros-args', '-p', f'gyro_{"x" * 6000}:=1')
    wait_for(lambda: nodes.client.status_of(process) is not None, what='its end')
    assert nodes.client.status_of(process) == 2
    assert 'has no parameter' in nodes.output_of('gyro_driver').read_text()


@pytest.mark.parametrize(
    ('number', 'status'), [(signal.SIGTERM, 0), (signal.SIGINT, 0), (signal.SIGKILL, -9)]
)
def test_the_end_of_a_node_is_reported(nodes, number, status):
    process, other = nodes.start('gyro_driver'), nodes.start('encoder_driver')
    nodes.await_start('gyro_driver')
    os.kill(process, number)
    nodes.client.await_end(process, LAST_RESORT_S)
    assert nodes.client.status_of(process) == status
    assert nodes.client.status_of(other) is None
    os.kill(other, signal.SIGKILL)
    nodes.client.await_end(other, LAST_RESORT_S)
    assert nodes.client.status_of(other) == -signal.SIGKILL


def test_a_mistake_in_the_parameters_is_status_2_and_a_line(nodes):
    process = nodes.start('gyro_driver', '--ros-args', '-p', 'offset:=much')
    nodes.client.await_end(process, LAST_RESORT_S)
    assert nodes.client.status_of(process) == 2
    # Check the last line only: the middleware may print something before it.
    assert nodes.output_of('gyro_driver').read_text().splitlines()[-1].startswith('error: ')


def test_a_wait_is_not_longer_than_allowed(nodes):
    process = nodes.start('gyro_driver')
    nodes.client.await_end(process, 0.05)
    assert nodes.client.status_of(process) is None


def test_a_plant_takes_over_the_lock_of_its_domain(nodes, domain):
    lock = DomainLock(domain)
    process = nodes.start('plant_sim', inherited={LOCK_FD_ENV: lock.file})
    lock.release()
    nodes.await_start('plant_sim')
    with pytest.raises(BallbotError, match='another plant'):
        DomainLock(domain)
    os.kill(process, signal.SIGKILL)
    nodes.client.await_end(process, LAST_RESORT_S)
    DomainLock(domain).release()


def test_no_node_outlives_the_fork_server(tmp_path, domain):
    with ForkClient() as client:
        nodes = Nodes(client, tmp_path, domain)
        process = nodes.start('gyro_driver')
        nodes.await_start('gyro_driver')
        (server,) = [each for each in children(os.getpid()) if process in children(each)]
        os.kill(server, signal.SIGKILL)
        # Before this, the client might still read the node's own status, 0, from the system.
        wait_for(client.failure, what='that the end of the fork server is noticed')
        client.await_end(process, LAST_RESORT_S)
        assert client.status_of(process) == -signal.SIGTERM
        assert not alive(process)
        killed = rf'encoder_driver cannot .* fork_server \(process {server}\) was killed by SIGKILL'
        with pytest.raises(BallbotError, match=killed):
            nodes.start('encoder_driver')


def test_a_stopped_fork_server_holds_nobody(tmp_path, domain):
    with ForkClient() as client:
        nodes = Nodes(client, tmp_path, domain)
        process = nodes.start('gyro_driver')
        (server,) = [each for each in children(os.getpid()) if process in children(each)]
        assert client.failure() == ''
        os.kill(server, signal.SIGSTOP)
        # The end of a node is known without it, also its status.
        os.kill(process, signal.SIGKILL)
        client.await_end(process, LAST_RESORT_S)
        assert client.status_of(process) == -signal.SIGKILL
        with pytest.raises(BallbotError, match=r'encoder_driver .* fork_server .* is stopped'):
            nodes.start('encoder_driver')
        wait_for(lambda: 'is stopped' in client.failure(), what='the judgement')
        os.kill(server, signal.SIGCONT)
        wait_for(lambda: client.failure() == '', what='a fork server that continues')
    assert not alive(server)


def test_a_python_without_the_current_folder_forks_nodes(monkeypatch):
    monkeypatch.setenv('PYTHONSAFEPATH', '1')
    with ForkClient() as client:
        client.await_ready()


def test_a_request_may_be_larger_than_a_message(nodes):
    """Each variable may have 128 KiB."""
    large = {f'LARGE_{number}': 'x' * 120_000 for number in range(3)}
    nodes.start('gyro_driver', '--ros-args', '--log-level', 'INFO', **large)
    nodes.await_start('gyro_driver')


COMMAND = """
import json, os, sys
from ballbot_ros.nodes.fork_server import NodeRequest
from ballbot_ros.run.node_process import ForkClient
client = ForkClient()
node = client.start(NodeRequest('gyro_driver', ['gyro_driver'], dict(os.environ)), 2)
print(json.dumps([client._server.pid, node]), flush=True)
sys.stdin.read()
"""


@pytest.mark.parametrize('hangs', ['nothing', 'the fork server', 'a node'])
def test_everything_ends_with_a_killed_command(hangs, domain):
    environment = {**os.environ, 'ROS_DOMAIN_ID': str(domain)}
    with contextlib.ExitStack() as stack:
        command = stack.enter_context(
            subprocess.Popen(
                [sys.executable, '-c', COMMAND], env=environment, stdin=-1, stdout=-1, stderr=-1
            )
        )
        server, node = json.loads(command.stdout.readline())
        stopped = {'the fork server': server, 'a node': node}.get(hangs)
        if stopped:
            os.kill(stopped, signal.SIGSTOP)
        command.kill()  # perhaps before the node knows its parent
        wait_for(lambda: not alive(server) and not alive(node), what='the end of both')


UNREAD = """
import json, os, signal, sys
from ballbot_ros.nodes.fork_server import NodeRequest
from ballbot_ros.run.node_process import ForkClient
client = ForkClient()
node = client.start(NodeRequest('gyro_driver', ['gyro_driver'], dict(os.environ)), 1)
os.kill(node, signal.SIGKILL)
client._has_message(60.0)
client._control.close()
print(client._server.wait())
"""


def test_the_fork_server_ends_in_silence_if_nobody_reads_how_nodes_ended(domain):
    environment = {**os.environ, 'ROS_DOMAIN_ID': str(domain)}
    done = subprocess.run(
        [sys.executable, '-c', UNREAD], env=environment, capture_output=True, text=True, check=True
    )
    assert (done.stdout, done.stderr) == ('0\n', '')


CHECK = """
import os, rclpy
from ballbot_ros.nodes.fork_server import import_nodes
import_nodes()
import sys
print(rclpy.ok(), {'ballbot_ros.nodes.plant_sim', 'ballbot_ros.nodes.recorder'} <= set(sys.modules))
"""


def test_the_fork_server_has_imported_the_nodes_but_not_initialised_ros():
    done = subprocess.run([sys.executable, '-c', CHECK], capture_output=True, text=True, check=True)
    assert done.stdout == 'False True\n'


@pytest.fixture
def served(monkeypatch):
    """Yield a client, the socket of its fork server, and the events of that process."""
    servers, events = [], []

    def start_server(command, *, pass_fds, **options):
        servers.append(socket.socket(fileno=os.dup(pass_fds[0])))
        return SimpleNamespace(
            pid=os.getpid(),
            poll=lambda: None,
            kill=lambda: events.append('killed'),
            wait=lambda timeout: events.append('awaited'),
        )

    monkeypatch.setattr(fork_client.subprocess, 'Popen', start_server)
    with ForkClient() as client, servers[0] as server:
        server.send(b'[""]')
        client.await_ready()
        yield client, server
    assert events == ['killed', 'awaited']


def test_a_process_number_may_be_used_again(served):
    client, server = served
    for status in (3, 0):
        server.send(b'[1234]')
        assert client.start(NodeRequest('gyro_driver', [], {}), 2) == 1234
        assert client.status_of(1234) is None
        server.send(f'[1234, {status}]'.encode())
        assert client.status_of(1234) == status


@pytest.mark.parametrize('silent_s', [5.0, 11.0])
def test_a_fork_may_take_some_seconds(served, monkeypatch, silent_s):
    """The system holds it up while other processes move between control groups."""
    client, server = served

    def measure_s(silence):
        server.send(b'[1234]')
        return silent_s

    monkeypatch.setattr(fork_client.ProcessSilence, 'measure_s', measure_s)
    if silent_s < 10.0:
        assert client.start(NodeRequest('gyro_driver', [], {}), 2) == 1234
    else:
        with pytest.raises(BallbotError, match=r'fork_server \(process \d+\) does not answer$'):
            client.start(NodeRequest('gyro_driver', [], {}), 2)


def test_nobody_waits_for_a_fork_when_the_run_should_stop(served):
    client, _ = served
    with pytest.raises(BallbotError, match=r'^gyro_driver cannot be started: the run is stopped$'):
        client.start(NodeRequest('gyro_driver', [], {}), 2, should_stop=lambda: True)


ORPHAN = """
import os
from ballbot_ros.nodes.fork_server import NodeRequest, become_node
server = os.getpid()
if os.fork() == 0:
    while os.getppid() == server:
        pass
    request = NodeRequest('gyro_driver', ['gyro_driver'], dict(os.environ))
    become_node(request, [os.dup(1)], server)
"""


def test_a_node_whose_fork_server_ends_before_it_starts_ends_too(domain):
    environment = {**os.environ, 'ROS_DOMAIN_ID': str(domain)}
    # The run returns when nobody holds its output any more.
    subprocess.run(
        [sys.executable, '-c', ORPHAN], env=environment, capture_output=True, check=True,
        timeout=LAST_RESORT_S,
    )  # fmt: skip


LONG_COMMAND_LINE = """
from pathlib import Path
from ballbot_ros.nodes.fork_server import set_command_line
set_command_line('long', ['x' * 100_000])
line = Path('/proc/self/cmdline').read_bytes()
assert line == b'x' * (len(line) - 1) + b'\\0', line
"""


def test_nothing_of_the_environment_follows_a_command_line_that_is_cut_off():
    subprocess.run([sys.executable, '-c', LONG_COMMAND_LINE], check=True)


@pytest.mark.parametrize(
    ('module', 'absent'),
    [
        ('ballbot_ros.cli.run', ('numpy', 'rclpy')),
        ('ballbot_ros.nodes.fork_server', ('numpy', 'rclpy')),
        ('ballbot_ros.nodes.gamepad_teleop', ('asyncio', 'websockets')),
    ],
)
def test_a_run_imports_little_before_it_starts_the_nodes(module, absent):
    code = f'import sys, {module}; print([name for name in {absent} if name in sys.modules])'
    done = subprocess.run([sys.executable, '-c', code], capture_output=True, text=True, check=False)
    assert (done.stdout, done.stderr) == ('[]\n', '')
