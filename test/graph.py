"""Starting runs and nodes as real processes, and observing them."""

import contextlib
import fcntl
import io
import json
import os
import signal
import socket
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import pytest

from ballbot_ros.cli.main import main
from ballbot_ros.errors import RecordingError
from ballbot_ros.nodes.fork_server import NodeRequest
from ballbot_ros.nodes.middleware import PORT_BASE, PORTS_PER_DOMAIN, bound_udp_ports
from ballbot_ros.parameters import NODES
from ballbot_ros.process import STOP_SIGNALS
from ballbot_ros.recording.reader import RecordingReader
from campaign.site import descendants

BALLBOT = [sys.executable, '-m', 'ballbot_ros.cli.main']
# Domains whose UDP ports the system does not assign to other programs: beyond 101 most domains use
# ephemeral ports, where a participant sometimes finds its ports occupied.
DOMAINS = (*range(215, 232), *range(50, 101))
LAST_RESORT_S = 240.0
"""Time after which a wait counts as hung, even on a busy machine; no test measures with it."""


@contextlib.contextmanager
def kept_handlers():
    """Restore the handlers of signals, which a command ignores after its end."""
    before = {number: signal.getsignal(number) for number in STOP_SIGNALS}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def call_main():
    """Run the command with the arguments in `sys.argv`; return its exit status."""
    with kept_handlers(), pytest.raises(SystemExit) as ended:
        main()
    return ended.value.code


def call(*words):
    """Run the command in this process; return a completed process, with text.

    To start Python and import the command costs more than most commands.
    """
    words = ['ballbot', *map(str, words)]
    stdout, stderr = (io.TextIOWrapper(io.BytesIO(), 'utf-8') for _ in range(2))
    with (
        pytest.MonkeyPatch.context() as patch,
        contextlib.redirect_stdout(stdout),
        contextlib.redirect_stderr(stderr),
    ):
        patch.setattr(sys, 'argv', words)
        status = call_main()
    for stream in (stdout, stderr):
        stream.seek(0)
    return subprocess.CompletedProcess(words, status, stdout.read(), stderr.read())


def record(folder, scenario, *arguments):
    """Run a scenario without nodes; return the recording and the JSON that the run printed."""
    done = call('run', scenario, '--processes=none', '--json', '--output', folder, *arguments)
    assert done.stderr == ''
    result = json.loads(done.stdout)
    return folder / f'{result["scenario"]}.mcap', result


def participants(domain):
    """The UDP ports of a ROS domain that processes on this machine have bound."""
    first = PORT_BASE + PORTS_PER_DOMAIN * domain
    return bound_udp_ports().intersection(range(first, first + PORTS_PER_DOMAIN))


@contextlib.contextmanager
def occupied(port):
    """Occupy a UDP port."""
    with contextlib.closing(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) as own:
        own.bind(('127.0.0.1', port))
        yield


@contextlib.contextmanager
def free_domain():
    """Yield a ROS domain that no other test or program on this machine uses meanwhile."""
    for domain in DOMAINS:
        if participants(domain):
            continue
        path = Path(tempfile.gettempdir()) / f'ballbot_test_domain_{domain}.lock'
        with path.open('w') as lock:
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                continue
            yield domain
            # Wait for the processes that have been told to end: the next test must not meet them.
            wait_for(
                lambda domain=domain: not participants(domain),
                what=f'the end of all in domain {domain}',
            )
            return
    raise RuntimeError('no free ROS domain')


def environment(domain):
    desktop = ('BROWSER', 'DISPLAY', 'WAYLAND_DISPLAY')  # tests open no windows
    return {
        **{name: value for name, value in os.environ.items() if name not in desktop},
        'ROS_DOMAIN_ID': str(domain),
        'PYTHONUNBUFFERED': '1',
    }


def private_shared_memory():
    """Return the start of a command that gets private shared memory; skip if it can't have any."""
    as_root = [] if os.geteuid() == 0 else ['--map-root-user']
    script = 'mount -t tmpfs tmpfs /dev/shm && exec "$@"'
    command = ['unshare', *as_root, '--mount', 'sh', '-c', script, 'sh']
    if subprocess.run([*command, 'true'], capture_output=True, check=False).returncode:
        pytest.skip('no mount namespace can be made here')
    return command


def wait_for(condition, what='it'):
    """Wait for a true value of the condition, and return it; checking must be cheap."""
    deadline = time.monotonic() + LAST_RESORT_S
    while time.monotonic() < deadline:
        value = condition()
        if value:
            return value
        time.sleep(0.01)
    raise TimeoutError(f'{what} did not happen')


def await_recording(path, topic='/motor_duty', count=20, run=None):
    """Wait until this many messages of a topic are on disk; fail at once if the run has ended."""
    looked_at = 0

    def is_there():
        nonlocal looked_at
        if run:
            run.assert_running()
        size = path.stat().st_size if path.exists() else 0
        if size == looked_at:
            return False
        looked_at = size
        with contextlib.suppress(RecordingError), RecordingReader(path) as reader:
            return sum(1 for _ in reader.raw_messages([topic])) >= count
        return False

    wait_for(is_there, what='the recording')


def state(pid):
    """Return the letter of a process's state: S if it waits, Z if it has ended, '' if gone."""
    try:
        return Path(f'/proc/{pid}/stat').read_text().rpartition(')')[2].split()[0]
    except OSError:
        return ''


def alive(pid):
    return state(pid) not in ('', 'Z')


def children(pid):
    """Return the node processes of a run: pid by name."""
    found = {}
    for child in descendants(pid):
        with contextlib.suppress(OSError):
            for word in Path(f'/proc/{child}/cmdline').read_bytes().split(b'\0'):
                name = word.decode()
                if name in (*NODES, 'viewer'):
                    found[name] = child
    return found


class Run:
    """`ballbot run` as a process."""

    def __init__(self, domain, *arguments, **popen):
        self.process = subprocess.Popen(
            [*BALLBOT, 'run', *map(str, arguments)],
            env=environment(domain),
            stdout=subprocess.PIPE,
            stdin=subprocess.DEVNULL,
            text=True,
            **{'stderr': subprocess.PIPE, **popen},
        )
        self.stderr = self.stdout = ''

    def assert_running(self):
        if self.process.poll() is not None:
            self.finish()
            raise AssertionError(f'the run has ended: {self.stdout}{self.stderr}')

    def nodes(self, expected=NODES):
        """Wait until the nodes have started; return their pids."""

        def look():
            self.assert_running()
            found = children(self.process.pid)
            return found if set(expected) <= set(found) else None

        return wait_for(look, what='the start of all nodes')

    def finish(self):
        """Wait for the end; return the exit status."""
        self.stdout, stderr = self.process.communicate(timeout=LAST_RESORT_S)
        self.stderr = stderr or ''
        return self.process.returncode

    @property
    def result(self):
        return json.loads(self.stdout)

    def kill(self):
        if self.process.poll() is None:
            pids = children(self.process.pid).values()
            self.process.kill()
            for pid in pids:
                with contextlib.suppress(ProcessLookupError):
                    os.kill(pid, signal.SIGKILL)
            self.process.communicate()


class ForkedProcess:
    """A fork of a fork server; used like :class:`subprocess.Popen`."""

    def __init__(self, client, name, arguments, environment):
        self._client = client
        output, theirs = os.pipe()
        self.stdout = os.fdopen(output, encoding='utf-8', errors='replace')
        try:
            self.pid = client.start(NodeRequest(name, [name, *arguments], environment), theirs)
        finally:
            os.close(theirs)

    def poll(self):
        return self._client.status_of(self.pid)

    @property
    def returncode(self):
        return self.poll()

    def send_signal(self, number):
        if self.poll() is None:
            with contextlib.suppress(ProcessLookupError):
                os.kill(self.pid, number)

    def terminate(self):
        self.send_signal(signal.SIGTERM)

    def kill(self):
        self.send_signal(signal.SIGKILL)

    def wait(self, timeout=LAST_RESORT_S):
        self._client.await_end(self.pid, timeout)
        if self.poll() is None:
            raise subprocess.TimeoutExpired(f'node {self.pid}', timeout)
        return self.poll()

    def communicate(self, timeout=LAST_RESORT_S):
        """Return the output after the end of the process."""
        self.wait(timeout)
        with self.stdout:
            return self.stdout.read(), None


class Node:
    """A node as a separate process."""

    def __init__(self, name, process):
        self.name, self.process = name, process
        self.output = ''

    @classmethod
    def fork(cls, client, domain, name, **values):
        """Fork a node of a process that has imported it, which saves half a second."""
        arguments = ros_arguments(**values)
        return cls(name, ForkedProcess(client, name, arguments, environment(domain)))

    @classmethod
    def run(cls, domain, name, **values):
        """Start a node as `ros2 run` does."""
        process = subprocess.Popen(
            [sys.executable, '-m', 'ballbot_ros.nodes', name, *ros_arguments(**values)],
            env=environment(domain),
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            stdin=subprocess.DEVNULL,
            text=True,
        )
        return cls(name, process)

    def lines_until(self, text):
        """Wait for a line with this text; return the lines up to it."""
        lines = []
        for line in self.process.stdout:
            lines.append(line)
            if text in line:
                return lines
        raise AssertionError(f'{self.name} has ended: {"".join(lines)}')

    def finish(self):
        self.output, _ = self.process.communicate(timeout=LAST_RESORT_S)
        return self.process.returncode

    def interrupt(self):
        self.process.send_signal(signal.SIGINT)
        return self.finish()

    def kill(self):
        self.process.kill()
        if not self.process.stdout.closed:
            self.output, _ = self.process.communicate()
        print(f'{self.name}:\n{self.output}')  # shown if the test has failed


def ros_arguments(remap='', **parameters):
    """Return the arguments that set parameters and remap a name."""
    words = [f'{key}:={value}' for key, value in parameters.items()]
    arguments = [argument for word in words for argument in ('-p', word)]
    return ['--ros-args', *arguments, *(['-r', remap] if remap else [])]
