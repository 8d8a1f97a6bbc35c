"""A node as a separate process."""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Callable, Collection, Mapping
from contextlib import suppress
from pathlib import Path
from types import MappingProxyType

from ballbot_ros.errors import BallbotError
from ballbot_ros.nodes.fork_server import NodeRequest
from ballbot_ros.nodes.processes import (
    exit_description,
    is_stopped,
    join_thread,
    threads_by_process,
)
from ballbot_ros.run.fork_client import ForkClient
from ballbot_ros.simulation.silence_timer import SilenceTimer

GRACE_S = 1.5
"""Time that a node has to end [s]."""

LAST_GRACE_S = 5.0
"""Time that the node stopped last has to end [s]; longer, because it finishes the recording."""

STOPPED_GRACE_S = 0.5
"""Time that a stopped process has to continue and end [s]."""

_POLL_S = 0.05
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
