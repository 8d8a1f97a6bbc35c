"""A process of its own that does parts of a study: for runs that are not compiled."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
from collections.abc import Callable
from contextlib import suppress
from multiprocessing.connection import Connection
from typing import TypeVar, cast

from ballbot_ros.errors import BallbotError, one_line
from ballbot_ros.nodes.processes import END_WITH_PARENT, end_with_parent, exit_description
from ballbot_ros.studies.errors import StudyError
from ballbot_ros.studies.job import Job
from ballbot_ros.studies.manifest import PartSummary
from ballbot_ros.studies.part_file import EncodedPart
from ballbot_ros.studies.runs import Samples

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

    def do(self, job: Job, part: int, samples: Samples) -> PartSummary:
        """Have a part done.

        Raises
        ------
        StudyError
            If it is not possible; WorkerEndedError if the process ends.
        """
        return self._call(Job.do, job, part, samples)

    def encode(self, job: Job, part: int, samples: Samples) -> EncodedPart:
        """Have a part simulated and judged, with the same errors."""
        return self._call(Job.encode, job, part, samples)

    def _call(self, method: Callable[..., _Answer], *arguments: object) -> _Answer:
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
