"""Nodes as separate processes: forks of one process that has imported them."""

from __future__ import annotations

import json
import os
import select
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from types import MappingProxyType

from ballbot_ros.errors import BallbotError
from ballbot_ros.lockstep.liveness import SilenceTimer
from ballbot_ros.nodes.fork_server import PROGRAM, ROOM, NodeRequest
from ballbot_ros.nodes.processes import (
    END_WITH_PARENT,
    ProcessSilence,
    exit_description,
    exit_status_of,
    is_alive,
    is_stopped,
    join_thread,
    threads_by_process,
)

IMPORT_S = 30.0
"""Time that the fork server has to import the nodes [s]; waits for a processor do not count."""

ANSWER_S = 10.0
"""The same for the answer to a request: the system holds up a fork while other processes move
between control groups, and these may wait for a processor."""

STOPPED_S = 1.5
"""Time for which it may be stopped, and which it has to end [s]."""

_POLL_S = 0.05


class ForkClient:
    """A fork server (:mod:`ballbot_ros.nodes.fork_server`), which lives as long as this context.

    The two exchange JSON over a socket that keeps messages apart. The server sends ``[error]``
    when it has imported the nodes: why there is no ROS, or ''. A request consists of descriptors:
    of a file with a :class:`~ballbot_ros.nodes.fork_server.NodeRequest`, whose environment may be
    too large for a message, of the node's output, and of what else it inherits. The answer is
    ``[pid]``. When a node has ended, ``[pid, status]`` follows. All nodes end when the fork server
    does. `ros_error` says why the fork server found no ROS; it is '' if it did, or is not ready.
    """

    def __init__(self) -> None:
        self._control, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._statuses: dict[int, int] = {}
        self._is_gone = self._is_ready = False
        self.ros_error = ''
        self._started = 0
        self._stopped_at_s: float | None = None
        with theirs:
            self._server = subprocess.Popen(
                [sys.executable, '-c', PROGRAM, str(theirs.fileno()), ROOM],
                # One thread for each node is enough; more would cost start-up time.
                env={
                    **os.environ,
                    'OPENBLAS_NUM_THREADS': '1',
                    END_WITH_PARENT: str(os.getpid()),
                },
                pass_fds=[theirs.fileno()],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                start_new_session=True,
            )

        self._name = f'fork_server (process {self._server.pid})'

    def __enter__(self) -> ForkClient:
        return self

    def __exit__(self, *error: object) -> None:
        self._control.close()
        self._server.kill()  # it may still be importing
        self._await_server()

    def _await_server(self) -> None:
        with suppress(subprocess.TimeoutExpired):
            self._server.wait(STOPPED_S)

    def failure(self) -> str:
        """Return why the fork server can't serve any more; '' while it can."""
        now_s = time.monotonic()
        if self._is_gone or self._server.poll() is not None:
            self._await_server()
            return f'{self._name} {exit_description(self._server.returncode)}'
        if not is_stopped(self._server.pid):
            self._stopped_at_s = None
        elif self._stopped_at_s is None:
            self._stopped_at_s = now_s
        elif now_s - self._stopped_at_s > STOPPED_S:
            return f'{self._name} is stopped'
        return ''

    def await_ready(self, should_stop: Callable[[], bool] = lambda: False) -> None:
        """Wait until the fork server has imported the nodes, or the run should stop.

        It raises BallbotError if it has ended, is stopped, or does not answer.
        """
        self._await(lambda: self._is_ready or should_stop(), IMPORT_S)

    def start(
        self,
        request: NodeRequest,
        output: int,
        inherited: Sequence[int] = (),
        should_stop: Callable[[], bool] = lambda: False,
    ) -> int:
        """Start a node, and return its process.

        It raises BallbotError if the fork server has ended, is stopped, or does not answer, or the
        run should stop.

        Parameters
        ----------
        output : int
            Descriptor of its standard output and standard error.
        inherited : sequence of int
            Descriptors for the variables that ``request.inherited`` names.
        should_stop : callable
            Returns whether nobody waits for the node any more.
        """
        try:
            self.await_ready(should_stop)
            self._started = 0
            with os.fdopen(os.memfd_create(request.name), 'w+', encoding='utf-8') as text:
                json.dump(request, text)
                text.seek(0)
                files = [text.fileno(), output, *inherited]
                with suppress(OSError):  # it has ended, which the wait for its answer finds out
                    socket.send_fds(self._control, [b' '], files)
            self._await(lambda: self._started > 0 or should_stop(), ANSWER_S)
            if not self._started:
                raise BallbotError('the run is stopped')
        except BallbotError as error:
            raise BallbotError(f'{request.name} cannot be started: {error}') from None
        return self._started

    def status_of(self, process: int) -> int | None:
        """Return the exit status of a node, negative for a signal; None while it runs."""
        while process not in self._statuses and not self._is_gone and self._has_message(0.0):
            self._receive()
        if process not in self._statuses:
            if self._is_gone:
                status = None if is_alive(process) else -signal.SIGTERM  # sent by the system
            else:
                status = exit_status_of(process)  # the fork server may be stopped
            if status is None:
                return None
            self._statuses[process] = status
        return self._statuses[process]

    def await_end(self, process: int, timeout_s: float) -> None:
        """Wait for the end of a node, for at most `timeout_s` [s]."""
        deadline = time.monotonic() + timeout_s
        while self.status_of(process) is None:
            remaining_s = min(deadline - time.monotonic(), _POLL_S)
            if remaining_s <= 0.0:
                return
            if self._is_gone:
                time.sleep(remaining_s)
            else:
                self._has_message(remaining_s)

    def _await(self, is_done: Callable[[], bool], limit_s: float) -> None:
        """Receive messages until `is_done`; raise BallbotError if that takes too long."""
        silence = ProcessSilence(self._server.pid)
        while not is_done():
            if self._has_message(_POLL_S):
                self._receive()
            if failure := self.failure():
                raise BallbotError(failure)
            if silence.measure_s() > limit_s:
                state = 'is stopped' if is_stopped(self._server.pid) else 'does not answer'
                raise BallbotError(f'{self._name} {state}')

    def _has_message(self, timeout_s: float) -> bool:
        return bool(select.select([self._control], [], [], timeout_s)[0])

    def _receive(self) -> None:
        """Receive a message."""
        try:
            message = self._control.recv(1 << 16)
        except OSError:
            message = b''
        if not message:
            self._is_gone = True
            return
        content = json.loads(message)
        if not self._is_ready:
            self._is_ready = True
            self.ros_error = content[0]
        elif len(content) == 2:
            process, self._statuses[process] = content
        else:
            self._started = content[0]
            self._statuses.pop(self._started, None)  # of an earlier node with the same number


GRACE_S = 1.5
"""Time that a node has to end [s]."""

LAST_GRACE_S = 5.0
"""Time that the node stopped last has to end [s]; longer, because it finishes the recording."""

STOPPED_GRACE_S = 0.5
"""Time that a stopped process has to continue and end [s]."""

_KILL_S = 1.0
"""Time after which a killed process is left to the system [s]."""

_ERROR = 'error: '
"""Start of the last line of a node that ended with an error."""


class NodeProcess:
    """A node, started with a parameter file, whose log lines are forwarded.

    Parameters
    ----------
    notice : callable
        Receives each line of the node's output.
    inherited : mapping of str to int
        Descriptors that it inherits, by the environment variables that tell them.
    variables : mapping of str to str
        Further environment variables.
    should_stop : callable
        Returns whether nobody waits for the node any more.
    """

    def __init__(
        self,
        client: ForkClient,
        name: str,
        parameter_file: Path,
        notice: Callable[[str], None],
        inherited: Mapping[str, int] = MappingProxyType({}),
        variables: Mapping[str, str] = MappingProxyType({}),
        should_stop: Callable[[], bool] = lambda: False,
    ) -> None:
        self.name = name
        self._client = client
        self._last_error_line = ''
        arguments = [
            name, '--ros-args', '--params-file', str(parameter_file), '--log-level', 'WARN',
        ]  # fmt: skip
        environment = {
            **os.environ,
            **variables,
            'RCUTILS_CONSOLE_OUTPUT_FORMAT': '{name}: {message}',
            'RCUTILS_COLORIZED_OUTPUT': '0',
        }
        output, theirs = os.pipe()
        try:
            self.pid = client.start(
                NodeRequest(name, arguments, environment, tuple(inherited)),
                theirs,
                tuple(inherited.values()),
                should_stop,
            )
        except BallbotError:
            os.close(output)
            raise
        finally:
            os.close(theirs)
        self._reader = threading.Thread(
            target=self._forward_output, args=(output, notice), daemon=True
        )
        self._reader.start()

    def _forward_output(self, output: int, notice: Callable[[str], None]) -> None:
        with open(output, encoding='utf-8', errors='replace') as lines:
            for line in lines:
                text = line.rstrip()
                if text.startswith((_ERROR, f'{self.name}: ')):
                    self._last_error_line = text.removeprefix(_ERROR).removeprefix(f'{self.name}: ')
                if text:
                    notice(text)

    @property
    def running(self) -> bool:
        """Whether the process is still running."""
        return self.exit_status is None

    @property
    def exit_status(self) -> int | None:
        """The exit status, a negative signal number, or None while it runs."""
        return self._client.status_of(self.pid)

    @property
    def was_killed(self) -> bool:
        """Whether it was killed by a signal."""
        status = self.exit_status
        return status is not None and status < 0

    @property
    def exit_description(self) -> str:
        """Description of how it ended."""
        return exit_description(self.exit_status)

    @property
    def failure(self) -> str:
        """Why the node failed: the error that it logged last, or else how it ended."""
        if self.was_killed or not self._last_error_line:
            return f'{self.name} {self.exit_description}'
        return f'{self.name}: {self._last_error_line}'

    def request_stop(self) -> None:
        """Send SIGTERM, which also quietly ends a node that is still starting."""
        self._send(signal.SIGTERM)

    def _send(self, number: signal.Signals) -> None:
        if self.running:
            with suppress(ProcessLookupError):
                os.kill(self.pid, number)

    def wait(self, timeout_s: float) -> None:
        """Wait for the end, for at most `timeout_s` [s]."""
        self._client.await_end(self.pid, timeout_s)

    def forward_remaining_output(self) -> None:
        """Forward the last lines of a process that has ended."""
        join_thread(self._reader, 0.2)

    def kill(self) -> None:
        """Send SIGKILL, which also ends a stopped process, and wait for the end for a moment."""
        self._send(signal.SIGKILL)
        self._client.await_end(self.pid, _KILL_S)


def stop_all(processes: Collection[NodeProcess], last: str) -> None:
    """Stop the processes, the one named `last` after the others so that it misses nothing."""
    others = [process for process in processes if process.name != last]
    rest = [process for process in processes if process.name == last]
    for batch, grace_s in ((others, GRACE_S), (rest, LAST_GRACE_S)):
        for process in batch:
            process.request_stop()
        _await_end(batch, grace_s)


def _await_end(processes: Collection[NodeProcess], grace_s: float) -> None:
    """Wait until all have ended, and kill each that takes longer than `grace_s` [s]."""
    begun, timer = time.monotonic(), SilenceTimer()
    awaited = list(processes)
    while awaited := [process for process in awaited if process.running]:
        threads = threads_by_process(process.pid for process in awaited)
        timer.update(begun, time.monotonic(), threads)
        for process in tuple(awaited):
            limit_s = STOPPED_GRACE_S if is_stopped(process.pid) else grace_s
            if timer.silence_s(process.pid) > limit_s:
                process.kill()
                awaited.remove(process)
        if awaited:
            awaited[0].wait(_POLL_S)
    for process in processes:
        process.forward_remaining_output()
