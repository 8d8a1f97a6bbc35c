"""Carrying out a study: which parts are missing, who does them, when to stop."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
import threading
from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from contextlib import ExitStack, suppress
from datetime import datetime
from multiprocessing.connection import Connection
from typing import Protocol, TypeVar, cast

from ballbot_ros.engine.compilation import NO_COMPILER, REMEDY
from ballbot_ros.errors import BallbotError, StudyError, one_line
from ballbot_ros.lab.studies.data_set import begin_or_resume
from ballbot_ros.lab.studies.job import Job
from ballbot_ros.lab.studies.manifest import PartSummary
from ballbot_ros.lab.studies.part_file import load_pyarrow
from ballbot_ros.lab.studies.programs import may_hang, programs_of, why_not_compiled
from ballbot_ros.lab.studies.runs import Advance, Samples
from ballbot_ros.lab.studies.sampling import Sampler
from ballbot_ros.nodes.processes import END_WITH_PARENT, end_with_parent, exit_description
from ballbot_ros.process import StopRequest

_PROGRAM = f'from {__name__} import main; main()'
_STANDARD_ERROR = 2
_Answer = TypeVar('_Answer')


class WorkerEndedError(StudyError):
    """A worker process has ended."""


class WorkerProcess:
    """A process that does one part after another.

    Unlike those of `multiprocessing` it does not import the main program again, and ends with this
    process. Ctrl-C does not reach it.
    """

    def __init__(self) -> None:
        ours, theirs = socket.socketpair()
        with theirs:
            self._process = subprocess.Popen(
                [sys.executable, '-c', _PROGRAM, str(theirs.fileno())],
                env={**os.environ, END_WITH_PARENT: str(os.getpid())},
                pass_fds=[theirs.fileno()],
                stdin=subprocess.DEVNULL,
                stdout=_STANDARD_ERROR,
                start_new_session=True,
            )
        self._connection = Connection(ours.detach())
        self._connection.send(sys.path)

    def call(self, method: Callable[..., _Answer], *arguments: object) -> _Answer:
        """Have a method of :class:`Job` called, with the job as its first argument.

        It raises StudyError if it is not possible, and WorkerEndedError if the process ends.
        """
        try:
            self._connection.send((method, arguments))
            answer = self._connection.recv()
        except (OSError, EOFError):
            end = exit_description(self._process.wait())
            raise WorkerEndedError(
                f'a worker process {end}; the same command goes on from there'
            ) from None
        if isinstance(answer, str):
            raise StudyError(answer)
        return cast(_Answer, answer)

    def kill(self) -> None:
        """End the process; a part in work is given up."""
        self._process.kill()


def call_safely(method: Callable[..., _Answer], job: Job, *arguments: object) -> _Answer:
    """Call a method of a job, in a process that can be ended if a run of it may hang."""
    if not may_hang(job.spec):
        return method(job, *arguments)
    process = WorkerProcess()
    try:
        return process.call(method, job, *arguments)
    finally:
        process.kill()


def main() -> None:
    """Do parts until the parent closes the connection."""
    if not end_with_parent():
        return
    connection = Connection(int(sys.argv[1]))
    with suppress(EOFError, OSError):  # the parent has ended, or needs no more
        sys.path[:] = connection.recv()
        while True:
            method, arguments = connection.recv()
            try:
                answer = method(*arguments)
            except BallbotError as error:
                answer = one_line(error)
            connection.send(answer)


ORDINARY_LIMIT_S = 50_000.0
"""Most sim time [s] for which the runs of a study are not compiled, though they could be."""

POLL_S = 0.2
"""Longest time after which a signal is noticed [s]."""


class StudyObserver:
    """Sees how a study or search goes on; this one shows nothing."""

    def begin(self, runs: int, done: PartSummary) -> None:
        """Show that a study of so many runs begins, or goes on after those that are done."""

    def advance(self, runs: int) -> None:
        """Show that so many more runs have been simulated; called by any thread."""

    def part(self, summary: PartSummary) -> None:
        """Show the runs of a part that has been written."""

    def generation(self, text: str) -> None:
        """Show what is known after another generation of a search."""

    def notice(self, text: str) -> None:
        """Show a line."""


class Workers(Protocol):
    """Those who do the parts of a job."""

    @property
    def count(self) -> int:
        """How many parts they do at a time; it may change."""

    def submit(self, part: int, samples: Samples) -> Future[PartSummary]:
        """Have a part done and written."""

    def close(self) -> None:
        """Give up the parts in work."""


WorkersOfJob = Callable[[Job, StudyObserver], Workers]
"""Finds workers for a job; BallbotError if there are none."""


class PartGivenUpError(BallbotError):
    """A part is given up, because the study is stopped."""


class StudyStoppedError(BallbotError):
    """A signal has stopped a study or search; nothing is lost."""

    def __init__(self, signal: int) -> None:
        super().__init__(f'stopped by signal {signal}')
        self.signal = signal


class LocalWorkers:
    """The cores of this machine: threads for compiled runs, or else processes.

    Compiled code runs in parallel in the threads of one process. Until it is on disk, processes
    compile it: nothing can interrupt the compiler, but a process can be killed. The same holds for
    the law of a user's controller.
    """

    def __init__(self, job: Job, observer: StudyObserver) -> None:
        self._job = job
        self._advance: Advance = observer.advance
        self.count = len(os.sched_getaffinity(0))
        self._stopped = False
        slow = _check_speed(job)
        if slow:
            observer.notice(slow)
        self._programs = None if slow else programs_of(job.spec)
        if self._programs and not self._programs.is_kept:
            observer.notice('compiling, which takes about 20 s the first time ...')
        self._is_kept = False
        self._processes: list[WorkerProcess] = []
        self._of_thread = threading.local()
        self._pool = ThreadPoolExecutor(self.count)

    def submit(self, part: int, samples: Samples) -> Future[PartSummary]:
        """Have a part done and written."""
        if self._may_use_threads():
            return self._pool.submit(self._job.do, part, samples, self._on_runs)
        return self._pool.submit(self._do_in_process, part, samples)

    def _may_use_threads(self) -> bool:
        """Return whether the code of the runs is kept, and not a user's."""
        if self._programs and not self._is_kept:
            self._is_kept = self._programs.is_kept and not self._programs.are_users
        return self._is_kept

    def _do_in_process(self, part: int, samples: Samples) -> PartSummary:
        """Have a part done by the process of this thread; if that is killed, by another one."""
        process: WorkerProcess | None = getattr(self._of_thread, 'process', None)
        try:
            summary = (process or self._new_process()).call(Job.do, self._job, part, samples)
        except WorkerEndedError:
            summary = self._new_process().call(Job.do, self._job, part, samples)
        self._on_runs(summary.runs)
        return summary

    def _new_process(self) -> WorkerProcess:
        """Start a process for this thread."""
        process = self._of_thread.process = WorkerProcess()
        self._processes.append(process)
        if self._stopped:  # since `close` may have killed the others already
            process.kill()
            raise PartGivenUpError('the study is stopped')
        return process

    def _on_runs(self, runs: int) -> None:
        if self._stopped:
            raise PartGivenUpError('the study is stopped')
        self._advance(runs)

    def close(self) -> None:
        """Give up the parts in work."""
        self._stopped = True
        for each in self._processes:
            each.kill()
        self._pool.shutdown(wait=True, cancel_futures=True)


def _check_speed(job: Job) -> str:
    """Return a notice if a study's runs are not compiled; or ''.

    It raises StudyError if the study is too long for the ordinary loop, though numba would do.
    """
    reason = why_not_compiled(job.spec)
    if not reason:
        return ''
    if reason != NO_COMPILER:
        return f'not compiled, so the runs take several hundred times as long: {reason}'
    length_s = job.record.runs * job.spec.plant.duration
    if length_s > ORDINARY_LIMIT_S:
        raise StudyError(
            f'{job.record.name}: {length_s:.3g} s of simulation need numba, {ORDINARY_LIMIT_S:g} s '
            f'at most do not: {REMEDY}'
        )
    return f'{NO_COMPILER}, so the runs take several hundred times as long: {REMEDY}'


Sample = Callable[[int, int], Samples]
"""Returns the samples of the runs from one number up to, but not including, another."""


class StudyRun:
    """A study that is carried out; a context in which its folder is locked.

    It raises BallbotError if the folder is another study's or can't be written.

    Parameters
    ----------
    workers : callable
        Finds workers when the first parts are done; by default the cores of this machine.
    again : bool
        Whether a study that is finished, or begun, is done from the start.

    Attributes
    ----------
    missing : list of int
        The parts that were not there at the beginning, in order.
    done : PartSummary
        Numbers of runs of the others.
    """

    missing: list[int]
    done: PartSummary

    def __init__(
        self,
        job: Job,
        observer: StudyObserver,
        workers: WorkersOfJob = LocalWorkers,
        *,
        again: bool = False,
    ) -> None:
        self.job, self._observer, self._find_workers = job, observer, workers
        self._again = again
        self._workers: Workers | None = None
        self._open = ExitStack()

    def __enter__(self) -> StudyRun:
        load_pyarrow()  # before the folder is created
        now = datetime.now().astimezone()
        with ExitStack() as stack:
            self._folder = stack.enter_context(
                begin_or_resume(self.job.folder, self.job.record, now)
            )
            if self._again and self._folder.resumed:
                self._folder.restart(now)
            check = self._folder.check_parts()
            self._open = stack.pop_all()
        for each in check.notices:
            self._observer.notice(each)
        self.missing, self.done = check.missing, check.summary
        return self

    def __exit__(self, *error: object) -> None:
        with self._open:
            if self._workers:
                self._workers.close()

    def do(self, parts: Sequence[int], sample: Sample) -> None:
        """Do parts.

        Raises
        ------
        StudyStoppedError
            If a signal stops it.
        BallbotError
            If a run is not possible, or a part can't be written.
        """
        if not parts:
            return
        # Outside of the block, in which signals are only noted: a cluster may take seconds to
        # answer.
        doing = self._workers = self._workers or self._find_workers(self.job, self._observer)
        # A second signal has its usual effect: it need not wait for a part that is in work.
        with StopRequest() as stop:
            rest = iter(parts)
            in_work: set[Future[PartSummary]] = set()
            while not stop.signal:
                while len(in_work) < 2 * doing.count and (part := next(rest, None)) is not None:
                    numbers = self.job.record.numbers(part)
                    in_work.add(doing.submit(part, sample(numbers.start, numbers.stop)))
                if not in_work:
                    return
                done, in_work = wait(in_work, POLL_S, FIRST_COMPLETED)
                for each in done:
                    self._observer.part(each.result())
            self._observer.notice(
                'stopping: parts in work are given up (Ctrl-C again ends at once)'
            )
            raise StudyStoppedError(stop.signal)

    def finish(self) -> None:
        """Check all parts, and note in the folder that the study is finished.

        It raises StudyError if a part is missing or damaged.
        """
        if not self.missing and self._folder.is_finished:
            return
        check = self._folder.finish(datetime.now().astimezone())
        if check.missing:
            raise StudyError(
                f'{self._folder.path}: {len(check.missing)} parts are missing or damaged; give the '
                'command again, which redoes them'
            )


def run_study(
    job: Job,
    observer: StudyObserver,
    workers: WorkersOfJob = LocalWorkers,
    *,
    again: bool = False,
) -> None:
    """Do all parts of a study that are missing in its folder; see :class:`StudyRun`.

    Raises
    ------
    StudyStoppedError
        If a signal stops it.
    BallbotError
        If the folder is another study's or can't be written, or a run is not possible.
    """
    with StudyRun(job, observer, workers, again=again) as run:
        observer.begin(job.record.runs, run.done)
        run.do(run.missing, Sampler(job.study).part)
        run.finish()
