"""The workers of a Dask cluster, which do the parts of a study."""

from __future__ import annotations

import asyncio
import logging
import pickle
import re
import warnings
from collections.abc import Coroutine, Iterator
from concurrent.futures import CancelledError, Future, ThreadPoolExecutor
from contextlib import ExitStack, contextmanager, suppress
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar, cast
from uuid import uuid4

import numpy as np
import scipy

import ballbot_ros
import ballbot_ros.lab.studies.worker_task
from ballbot_ros.engine.compilation import code_sha256
from ballbot_ros.errors import StudyError, importing, one_line
from ballbot_ros.lab.studies.execution import StudyObserver, WorkersOfJob
from ballbot_ros.lab.studies.job import Job, PackedJob
from ballbot_ros.lab.studies.manifest import PartSummary
from ballbot_ros.lab.studies.part_file import EncodedPart
from ballbot_ros.lab.studies.runs import Samples
from ballbot_ros.lab.studies.worker_task import Answer
from ballbot_ros.run.graph import version_of

if TYPE_CHECKING:
    from distributed import Client


@cache
def worker_versions() -> dict[str, str]:
    """Return the versions that must be the same on all workers, by name.

    Python and numba may differ: the compiled code keeps the operations of IEEE arithmetic and their
    order, whoever compiles it.
    """
    return {
        'ballbot_ros': ballbot_ros.__version__,
        'code of ballbot_ros': f'SHA-256 {code_sha256()}',
        'numpy': np.__version__,
        'scipy': scipy.__version__,
        'distributed': version_of('distributed'),
    }


CONNECT_TIMEOUT_S = 10.0
"""How long a scheduler has to answer [s]."""

_Result = TypeVar('_Result')

_WATCH_S = 1.0
_CLOSE_TIMEOUT_S = 2.0
_STORING_THREADS = 4

_ADDRESS = re.compile(r'(tcp|tls)://[^/\s]+:\d{1,5}')
_EXAMPLE = 'tcp://HOST:8786 or tls://HOST:8786'

# Only objects that every Python has go through scheduler and workers: a function of this package
# would have to be importable on both. `exec` defines `do_part` in the names that `eval` is given.
_EXPRESSION = 'exec(text) or do_part(required, payload)'

_LOGGERS = ('distributed', 'distributed.client', 'distributed.comm', 'tornado', 'asyncio')


def workers_of(address: str) -> WorkersOfJob:
    """Return a function that finds the workers of a scheduler; StudyError for a wrong address."""
    if not _ADDRESS.fullmatch(address):
        raise StudyError(f'--cluster {address}: not the address of a scheduler; give {_EXAMPLE}')
    return lambda job, observer: ClusterWorkers(address, job, observer)


class ClusterWorkers:
    """The workers that a Dask scheduler has; others may join and leave at any time.

    A worker returns the file of a part, which is stored here. So it needs no access to the study's
    folder, and if it ends, the scheduler gives its parts to others. It raises BallbotError if there
    is no scheduler that can be used, Dask is not installed, or a file of the job can't be read.
    """

    def __init__(self, address: str, job: Job, observer: StudyObserver) -> None:
        self._address, self._job, self._observer = address, job, observer
        self._packed = PackedJob.of(job)
        self._key = f'{job.record.name}-{uuid4().hex}'
        with ExitStack() as stack:
            stack.enter_context(_quiet())
            self._client = _connect(address)
            self._quiet = stack.pop_all()
        self._loop = self._client.loop.asyncio_loop
        self._storing = ThreadPoolExecutor(_STORING_THREADS)
        self._threads = -1
        self._watching = self._run(self._watch())

    @property
    def count(self) -> int:
        """The number of threads of all workers; 1 if there are none, so that a part waits."""
        return max(1, self._threads)

    def submit(self, part: int, samples: Samples) -> Future[PartSummary]:
        """Have a part done and written."""
        return self._run(self._do(part, pickle.dumps((self._packed, part, samples))))

    def close(self) -> None:
        """Give up the parts in work: the scheduler forgets them."""
        self._watching.cancel()
        self._storing.shutdown(wait=True)
        with suppress(Exception):  # a scheduler that has ended
            self._client.close(timeout=_CLOSE_TIMEOUT_S)
        self._quiet.close()

    def _run(self, coroutine: Coroutine[Any, Any, _Result]) -> Future[_Result]:
        return asyncio.run_coroutine_threadsafe(coroutine, self._loop)

    async def _do(self, part: int, payload: bytes) -> PartSummary:
        fault, data, counts = await self._answer(part, payload)
        if fault:
            raise StudyError(one_line(fault))
        encoded = EncodedPart(data, PartSummary(*counts))
        summary: PartSummary = await self._loop.run_in_executor(
            self._storing, self._job.store, part, encoded
        )
        self._observer.advance(summary.runs)
        return summary

    async def _answer(self, part: int, payload: bytes) -> Answer:
        from distributed import KilledWorker

        names = {'text': _task_text(), 'required': worker_versions(), 'payload': payload}
        task = self._client.submit(eval, _EXPRESSION, names, key=(self._key, part), pure=False)
        try:
            return cast(Answer, await self._client.gather(task, asynchronous=True))
        except CancelledError:
            raise StudyError(
                f'{self._address}: lost the scheduler; start it again and give the same command, '
                'which goes on where it stopped'
            ) from None
        except KilledWorker as error:
            raise StudyError(
                f'part {part}: {error.allowed_failures + 1} workers have ended doing it, the last '
                f'was {error.last_worker.address} (no memory left?); give the command again, which '
                'goes on where it stopped'
            ) from None
        except Exception as error:
            raise StudyError(f'{self._address}: {_described(error)}') from None

    async def _watch(self) -> None:
        """Note how many threads the workers have, and show if there are none."""
        while True:
            with suppress(OSError):  # a lost scheduler is noticed by the parts
                threads = await self._client.scheduler.ncores()
                had, self._threads = self._threads, sum(threads.values())
                if not self._threads and had:
                    self._observer.notice(
                        f'no worker at {self._address}; waiting for `dask worker {self._address}`'
                    )
                elif self._threads and had <= 0:
                    self._observer.notice(
                        f'{self._address}: {len(threads)} workers with {self._threads} threads'
                    )
            await asyncio.sleep(_WATCH_S)


@cache
def _task_text() -> str:
    return Path(ballbot_ros.lab.studies.worker_task.__file__).read_text(encoding='utf-8')


def _connect(address: str) -> Client:
    """Return a client of a scheduler that has the same release of Dask."""
    with importing('cluster'):
        from distributed import Client
        from distributed.versions import VersionMismatchWarning
    try:
        # In a thread, since this one may have a loop of its own, such as that of a notebook.
        with ThreadPoolExecutor(1) as pool:
            release = pool.submit(asyncio.run, _release(address)).result()
        own = worker_versions()['distributed']
        if release != own:
            raise StudyError(
                f'{address}: the scheduler has distributed {release}, this command {own}; install '
                'the same release for all'
            )
        with warnings.catch_warnings():
            # What matters is compared here and by each worker.
            warnings.simplefilter('ignore', VersionMismatchWarning)
            return Client(address, timeout=CONNECT_TIMEOUT_S, set_as_default=False)
    except StudyError:
        raise
    except (OSError, TimeoutError, asyncio.TimeoutError):
        raise StudyError(
            f'{address}: no Dask scheduler answers; start one with `dask scheduler`, or correct '
            '--cluster'
        ) from None
    except Exception as error:
        raise StudyError(f'{address}: {_described(error)}') from None


async def _release(address: str) -> str:
    """Return a scheduler's release of Dask; a client would wait forever for one that is silent."""
    from distributed import rpc
    from distributed.security import Security

    arguments = Security().get_connection_args('client')
    async with rpc(address, timeout=CONNECT_TIMEOUT_S, connection_args=arguments) as scheduler:
        kind = (await asyncio.wait_for(scheduler.identity(), CONNECT_TIMEOUT_S))['type']
        if kind != 'Scheduler':
            raise StudyError(f'{address}: a {kind.lower()} of Dask, not a scheduler')
        answer = await asyncio.wait_for(scheduler.versions(packages=[]), CONNECT_TIMEOUT_S)
        return str(answer['packages']['distributed'])


def _described(error: Exception) -> str:
    return f'{type(error).__name__}: {one_line(error)}'.removesuffix(': ')


@contextmanager
def _quiet() -> Iterator[None]:
    """Silence Dask, whose errors are reported on one line here."""
    loggers = [logging.getLogger(name) for name in _LOGGERS]
    levels = [each.level for each in loggers]
    for each in loggers:
        each.setLevel(logging.CRITICAL + 1)
    try:
        yield
    finally:
        for each, level in zip(loggers, levels, strict=True):
            each.setLevel(level)
