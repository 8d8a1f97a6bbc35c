"""The site of a trial: its folder, ROS domains, processes and their time."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

from ballbot_ros.lockstep.liveness import MAX_POLL_GAP_S, Threads, available_s
from ballbot_ros.nodes.processes import threads_by_process
from ballbot_ros.parameters import NODES

MARK = 'BALLBOT_CAMPAIGN_TRIAL'
"""Environment variable that identifies the processes of a trial, including leftover ones."""

BALLBOT = ('ballbot_ros.cli.main',)
DOMAINS_EACH = 3
DIRECTLY = 'exec "$@"'

_POLL_S = 0.05
START_S = 60.0
"""Time limit for the start of a process or a first message [s]."""


class CampaignError(Exception):
    """A trial could not be run, so nothing is known about the fault."""


class Stopwatch:
    """Measures the processor time available to processes.

    Time that processes spend waiting for a processor does not count, so that bounds on this time
    also hold on a busy machine.

    Attributes
    ----------
    elapsed_s : float
        The time from the start to the last update [s].
    """

    def __init__(self) -> None:
        self.elapsed_s = 0.0
        self._polled_at_s = time.monotonic()
        self._known: dict[int, Threads] = {}

    def update(self, processes: Iterable[int]) -> float:
        """Add the time that the most delayed process had available since the last update.

        Parameters
        ----------
        processes : iterable of int
            The living processes.

        Returns
        -------
        float
            :attr:`elapsed_s`.
        """
        now_s = time.monotonic()
        span_s = min(now_s - self._polled_at_s, MAX_POLL_GAP_S)
        self._polled_at_s = now_s
        before, self._known = self._known, threads_by_process(processes)
        had_s = [
            available_s(threads, before[process], span_s)
            for process, threads in self._known.items()
            if process in before
        ]
        self.elapsed_s += min(had_s, default=span_s)
        return self.elapsed_s


class End(NamedTuple):
    """End of the processes of a trial.

    Attributes
    ----------
    status : int or None
        Exit status of the program, or a negative signal number; None if it had to be killed.
    took_s : float
        Available time until no process was left [s].
    survivors : tuple of str
        Processes that were still running when the program had ended.
    """

    status: int | None
    took_s: float
    survivors: tuple[str, ...]


class Program:
    """A Python module as a process of a trial, with its output in files.

    Parameters
    ----------
    name : str
        Name of the files.
    words : sequence of str
        The module and its arguments.
    folder : Path
        Folder for the files.
    environment : mapping of str to str
    shell : str
        What ``sh -c`` does with the command, which is ``"$@"``.
    """

    def __init__(
        self,
        name: str,
        words: Sequence[object],
        folder: Path,
        environment: Mapping[str, str],
        shell: str = DIRECTLY,
    ) -> None:
        self.name = name
        self._paths = [folder / f'{name}.{stream}' for stream in ('stdout', 'stderr')]
        with self._paths[0].open('wb') as stdout, self._paths[1].open('wb') as stderr:
            self._process = subprocess.Popen(
                ['sh', '-c', shell, 'sh', sys.executable, '-m', *map(str, words)],
                env=environment,
                stdin=subprocess.DEVNULL,
                stdout=stdout,
                stderr=stderr,
            )
        self.pid = self._process.pid

    @property
    def status(self) -> int | None:
        """The exit status, a negative signal number, or None while it runs."""
        return self._process.poll()

    @property
    def stdout(self) -> str:
        """Its standard output so far."""
        return self._paths[0].read_text(errors='replace')

    @property
    def text(self) -> str:
        """All its output so far."""
        return ''.join(path.read_text(errors='replace') for path in self._paths)

    def send(self, number: signal.Signals) -> None:
        """Send a signal if it is still running."""
        if self.status is None:
            self._process.send_signal(number)

    def nodes(self) -> dict[str, int]:
        """Return the process ids of the nodes that it has started, by name."""
        commands = self._commands().items()
        return {name: child for child, words in commands for name in NODES if name in words}

    def find(self, helper: str) -> int | None:
        """Return the process that it has started whose command line contains `helper`."""
        commands = self._commands().items()
        return next((child for child, words in commands if helper in ' '.join(words)), None)

    def _commands(self) -> dict[int, list[str]]:
        found = {}
        for child in descendants(self.pid):
            with suppress(OSError):
                found[child] = Path(f'/proc/{child}/cmdline').read_text().split('\0')
        return found


def children(parent: int) -> list[int]:
    """Return the children of a process, including ended ones that it has not yet waited for."""
    found: list[int] = []
    for path in Path(f'/proc/{parent}/task').glob('*/children'):
        with suppress(OSError):  # the thread, or its process, has just ended
            found += map(int, path.read_text().split())
    return found


def descendants(ancestor: int) -> list[int]:
    """Return the children of a process, and theirs, and so on."""
    found = children(ancestor)
    return found + [each for child in found for each in descendants(child)]


class Site:
    """The site of a trial: a context manager that kills the trial's remaining processes at exit.

    Parameters
    ----------
    folder : Path
        Contains everything that the trial writes.
    domains : sequence of int
        ROS domains that no other program uses meanwhile.

    Attributes
    ----------
    variables : mapping
        Environment variables of its processes; None removes one.
    shell : str
        What ``sh -c`` does with a command, which is ``"$@"``.
    """

    def __init__(self, folder: Path, domains: Sequence[int]) -> None:
        self.folder = folder.resolve()
        self.domains = domains
        self.temporary = self.folder / 'tmp'
        self.variables: Mapping[str, str | None] = {}
        self.shell = DIRECTLY

    def __enter__(self) -> Site:
        self.temporary.mkdir(parents=True)
        return self

    def __exit__(self, *error: object) -> None:
        end_all(self.folder)

    def environment(self, domain: int | None = None) -> dict[str, str]:
        """Return the environment of a process of the trial."""
        environment = {
            **os.environ,
            MARK: str(self.folder),
            'TMPDIR': str(self.temporary),
            'ROS_DOMAIN_ID': str(self.domains[0] if domain is None else domain),
            'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST',
            'OPENBLAS_NUM_THREADS': '1',
            'PYTHONUNBUFFERED': '1',
            **self.variables,
        }
        return {name: value for name, value in environment.items() if value is not None}

    def start(self, name: str, *words: object, domain: int | None = None) -> Program:
        """Start a Python module as a process."""
        return Program(name, words, self.folder, self.environment(domain), self.shell)

    def start_node(self, node: str, number: int = 0, **parameters: object) -> Program:
        """Start a node alone, like ``ros2 run``; `number` counts its restarts."""
        settings = [f'{key}:={value}' for key, value in parameters.items()]
        arguments = [word for setting in settings for word in ('-p', setting)]
        words = ('ballbot_ros.nodes', node, '--ros-args', *arguments)
        return self.start(f'{node}_{number}' if number else node, *words)

    def alive(self) -> dict[int, str]:
        """Return the living processes of the trial with their command lines."""
        return processes_of(self.folder)

    def await_end(self, program: Program, bound_s: float, beside: Collection[int] = ()) -> End:
        """Wait until a program and the processes of the trial have ended; kill them at the limit.

        Parameters
        ----------
        program : Program
        bound_s : float
            Time limit [s].
        beside : collection of int
            Processes of the trial that need not end.
        """
        watch = Stopwatch()
        survivors: tuple[str, ...] | None = None
        while True:
            status = program.status
            alive = {pid: what for pid, what in self.alive().items() if pid not in beside}
            if status is not None and survivors is None:
                survivors = tuple(alive.values())
            if survivors is not None and not alive:
                return End(status, watch.elapsed_s, survivors)
            if watch.update(alive) > bound_s:
                end_all(self.folder)
                return End(status, watch.elapsed_s, tuple(alive.values()))
            time.sleep(_POLL_S)


def wait_until(condition: Callable[[], bool], what: str) -> None:
    """Wait for a condition before the fault.

    Raises
    ------
    CampaignError
        If it is not met in time.
    """
    watch = Stopwatch()
    while not condition():
        if watch.update([os.getpid()]) > START_S:
            raise CampaignError(f'{what} did not appear within {START_S:.0f} s')
        time.sleep(_POLL_S)


def processes_of(folder: Path) -> dict[int, str]:
    """Return the other processes of the trial in a folder, with their command lines."""
    mark = f'{MARK}={folder}'.encode()
    found = {}
    for entry in Path('/proc').glob('[0-9]*'):
        process = int(entry.name)
        with suppress(OSError):
            if process != os.getpid() and mark in (entry / 'environ').read_bytes().split(b'\0'):
                words = (entry / 'cmdline').read_text(errors='replace').split('\0')
                found[process] = ' '.join(words[1:4]) or entry.name
    return found


def end_all(folder: Path) -> None:
    """Kill the remaining processes of the trial in a folder."""
    while alive := processes_of(folder):
        for process in alive:
            with suppress(ProcessLookupError):
                os.kill(process, signal.SIGKILL)
        time.sleep(_POLL_S)
