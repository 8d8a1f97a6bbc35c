"""A node as a separate process."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Collection
from contextlib import suppress
from pathlib import Path

from ballbot_ros.nodes.domain_lock import LOCK_FD_ENV, DomainLock
from ballbot_ros.nodes.processes import END_WITH_PARENT, threads_by_process
from ballbot_ros.simulation.silence_timer import SilenceTimer

GRACE_S = 1.5
"""Time that a node has to end [s]."""

LAST_GRACE_S = 5.0
"""Time that the node stopped last has to end [s]; longer, because it finishes the recording."""

_POLL_S = 0.05
_ERROR = 'error: '
"""Start of the last line of a node that ended with an error."""


class NodeProcess:
    """A node, started with a parameter file, whose log lines are forwarded.

    Parameters
    ----------
    name : str
        The node.
    parameter_file : Path
    notice : callable
        Receives each line of the node's output.
    lock : DomainLock or None
        The lock of the ROS domain, passed on to a plant; None for any other node.
    """

    def __init__(
        self,
        name: str,
        parameter_file: Path,
        notice: Callable[[str], None],
        lock: DomainLock | None = None,
    ) -> None:
        self.name = name
        self._last_error_line = ''
        self._process = subprocess.Popen(
            [
                sys.executable, '-m', 'ballbot_ros.nodes', name,
                '--ros-args', '--params-file', str(parameter_file), '--log-level', 'WARN',
            ],
            env={
                **os.environ,
                # One thread for each node is enough; more would cost start-up time.
                'OPENBLAS_NUM_THREADS': '1',
                'RCUTILS_CONSOLE_OUTPUT_FORMAT': '{name}: {message}',
                'RCUTILS_COLORIZED_OUTPUT': '0',
                END_WITH_PARENT: str(os.getpid()),
                **({LOCK_FD_ENV: str(lock.file)} if lock else {}),
            },
            pass_fds=(lock.file,) if lock else (),
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            # Keep Ctrl-C from the node: it is for the run, which then stops its nodes in order.
            start_new_session=True,
        )  # fmt: skip
        self._reader = threading.Thread(target=self._forward_output, args=(notice,), daemon=True)
        self._reader.start()

    def _forward_output(self, notice: Callable[[str], None]) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            text = line.decode(errors='replace').rstrip()
            if text.startswith((_ERROR, f'{self.name}: ')):
                self._last_error_line = text.removeprefix(_ERROR).removeprefix(f'{self.name}: ')
            if text:
                notice(text)

    @property
    def pid(self) -> int:
        """The process id."""
        return self._process.pid

    @property
    def running(self) -> bool:
        """Whether the process is still running."""
        return self._process.poll() is None

    @property
    def exit_status(self) -> int | None:
        """The exit status, a negative signal number, or None while it runs."""
        return self._process.poll()

    @property
    def was_killed(self) -> bool:
        """Whether it was killed by a signal."""
        status = self.exit_status
        return status is not None and status < 0

    @property
    def exit_description(self) -> str:
        """Description of how it ended."""
        status = self.exit_status
        if status is None:
            return 'is still running'
        if status < 0:
            return f'was killed by {signal.Signals(-status).name}'
        return f'ended with status {status}'

    @property
    def failure(self) -> str:
        """Why the node failed: the error that it logged last, or else how it ended."""
        if self.was_killed or not self._last_error_line:
            return f'{self.name} {self.exit_description}'
        return f'{self.name}: {self._last_error_line}'

    def request_stop(self) -> None:
        """Send SIGTERM, which also quietly ends a node that is still starting."""
        if self.running:
            self._process.terminate()

    def wait(self, timeout_s: float) -> None:
        """Wait for the end, for at most `timeout_s` [s]."""
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(timeout_s)

    def forward_remaining_output(self) -> None:
        """Forward the last lines of a process that has ended."""
        self._reader.join(0.2)

    def kill(self) -> None:
        """Send SIGKILL, which also ends a stopped process."""
        self._process.kill()
        self._process.wait()


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
    while running := [process for process in processes if process.running]:
        threads = threads_by_process(process.pid for process in running)
        timer.update(begun, time.monotonic(), threads)
        for process in running:
            if timer.silence_s(process.pid) > grace_s:
                process.kill()
        running[0].wait(_POLL_S)
    for process in processes:
        process.forward_remaining_output()
