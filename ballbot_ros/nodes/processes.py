"""The processes on this machine: what the system tells of them, and signs of life.

Signs of life go through a pipe, so that no call of the middleware can keep the command from ending.
"""

from __future__ import annotations

import ctypes
import json
import os
import signal
import struct
import time
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from threading import Thread
from typing import NamedTuple

from ballbot_ros.lockstep.liveness import Observation, SilenceTimer, Threads, ThreadTime
from ballbot_ros.lockstep.participants import LocalNode

END_WITH_PARENT = 'BALLBOT_END_WITH_PARENT'
"""Environment variable: the parent process, a command, whose end also ends the node."""

_STARTED_NODES = 'BALLBOT_STARTED_NODES'
"""Environment variable of a plant: the processes of the nodes that its command has started."""

_JOIN_POLL_S = 0.05
_PR_SET_PDEATHSIG = 1
_PROC = Path('/proc')
_RUNNABLE, _ZOMBIE, _STOPPED = 'R', 'Z', 'T'
_STATE, _THREADS, _EXIT_CODE = 0, 17, 49
"""Fields of ``/proc/PID/stat`` after the name of the program."""


def end_with_parent(number: signal.Signals = signal.SIGTERM) -> bool:
    """Let the system send a signal here when the process in :data:`END_WITH_PARENT`, if any, ends.

    Return False if that process has already ended.
    """
    parent = os.environ.get(END_WITH_PARENT)
    if parent is None:
        return True
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, number)
    return os.getppid() == int(parent)


def threads_of(process: int) -> Threads:
    """Return the processor time of the threads of a process.

    There are none if the process is gone, or the kernel does not account for threads.
    """
    found = {}
    with suppress(OSError):
        for thread in (_PROC / str(process) / 'task').iterdir():
            # The thread may just have ended, or the kernel does not account for it.
            with suppress(OSError):
                cpu_ns, queued_ns, _ = map(int, (thread / 'schedstat').read_text().split())
                state = (thread / 'stat').read_text().rpartition(')')[2].split()[0]
                if cpu_ns and state != _ZOMBIE:
                    time = ThreadTime(cpu_ns * 1e-9, queued_ns * 1e-9, state == _RUNNABLE)
                    found[int(thread.name)] = time
    return found


def is_alive(process: int) -> bool:
    """Return whether a process runs, also if it is stopped."""
    stat = _stat(process)
    return bool(stat) and not _has_ended(stat)


def is_stopped(process: int) -> bool:
    """Return whether a process is stopped, for example by SIGSTOP."""
    stat = _stat(process)
    return bool(stat) and stat[_STATE] == _STOPPED


def exit_status_of(process: int) -> int | None:
    """Return the status of an ended process that nobody has waited for yet, negative for a signal.

    It is None for any other process, also for one that is gone.
    """
    stat = _stat(process)
    if not stat or not _has_ended(stat):
        return None
    return os.waitstatus_to_exitcode(int(stat[_EXIT_CODE]))


def _has_ended(stat: Sequence[str]) -> bool:
    """Return whether a process has ended: its main thread, and all others, which have its files."""
    return stat[_STATE] == _ZOMBIE and int(stat[_THREADS]) <= 1


def _stat(process: int) -> list[str]:
    try:
        stat = (_PROC / str(process) / 'stat').read_text()
    except OSError:
        return []
    return stat.rpartition(')')[2].split()


def threads_by_process(processes: Iterable[int]) -> dict[int, Threads]:
    """Return the processor time of the threads of each process for which it is known."""
    found = {process: threads_of(process) for process in processes}
    return {process: threads for process, threads in found.items() if threads}


class ProcessSilence:
    """The silence of a process since the creation of this object, without waits for a processor."""

    def __init__(self, process: int) -> None:
        self._process, self._timer = process, SilenceTimer()
        self._begun_s = time.monotonic()

    def measure_s(self) -> float:
        """Return the silence so far [s]; call often."""
        threads = threads_by_process([self._process])
        self._timer.update(self._begun_s, time.monotonic(), threads)
        return self._timer.silence_s(self._process)


def join_thread(thread: Thread, limit_s: float) -> None:
    """Wait for the end of a thread; the limit [s] is that of a :class:`ProcessSilence`."""
    silence = ProcessSilence(os.getpid())
    while thread.is_alive() and silence.measure_s() < limit_s:
        thread.join(_JOIN_POLL_S)


class LocalProcessObserver:
    """Observes the processes of this machine, for a liveness monitor."""

    def observe(self, processes: Iterable[int]) -> Observation:
        """Return the processor time that some processes have received so far."""
        return Observation(time.monotonic(), threads_by_process(processes))

    def started_nodes(self) -> list[LocalNode]:
        """Return the living nodes that the command of this plant has started."""
        started = json.loads(os.environ.get(_STARTED_NODES, '{}'))
        return [LocalNode(*node) for node in started.items() if is_alive(node[1])]


def started_nodes_variable(processes: Mapping[str, int]) -> dict[str, str]:
    """Return the environment variable that tells a plant the processes of its nodes, by role."""
    return {_STARTED_NODES: json.dumps(processes)}


def exit_description(status: int | None) -> str:
    """Return how a process has ended, for its exit status or negative signal number."""
    if status is None:
        return 'is still running'
    if status >= 0:
        return f'ended with status {status}'
    try:
        return f'was killed by {signal.Signals(-status).name}'
    except ValueError:  # a real-time signal has no name
        return f'was killed by signal {-status}'


HEARTBEAT_FD_ENV = 'BALLBOT_HEARTBEAT'
"""Environment variable of a plant: file descriptor of the pipe, inherited from its command."""

HEARTBEAT_S = 0.1
"""Period of the heartbeats [s]."""

_MESSAGE = struct.Struct('<q?')
_MAX_BYTES = _MESSAGE.size * 4096


class Heartbeat(NamedTuple):
    """What the plant tells: sim time [ns], 0 before the first tick, and the end of the run."""

    now_ns: int
    has_ended: bool


class HeartbeatSender:
    """Sends the heartbeats of this process, if its command wants any."""

    def __init__(self) -> None:
        file = os.environ.get(HEARTBEAT_FD_ENV)
        self.file = int(file) if file else None

    def send(self, beat: Heartbeat) -> None:
        """Send a heartbeat, unless the command has ended or does not read."""
        if self.file is not None:
            with suppress(BrokenPipeError, BlockingIOError):
                os.write(self.file, _MESSAGE.pack(*beat))


class HeartbeatPipe:
    """The pipe of a command; `theirs` is the descriptor for the plant."""

    def __init__(self) -> None:
        self._ours, self.theirs = os.pipe()
        for file in (self._ours, self.theirs):
            os.set_blocking(file, False)

    def newest(self) -> Heartbeat | None:
        """Return the newest heartbeat since the last call, if there is any."""
        try:
            data = os.read(self._ours, _MAX_BYTES)
        except BlockingIOError:
            return None
        beats = [Heartbeat(*beat) for beat in _MESSAGE.iter_unpack(data)]
        return beats[-1] if beats else None

    def close(self) -> None:
        """Close both ends."""
        os.close(self._ours)
        os.close(self.theirs)
