"""Schedulers and workers of Dask as processes, on the loopback only."""

import json
import os
import signal
import subprocess
import sys
import time
from contextlib import ExitStack, contextmanager
from pathlib import Path

from graph import LAST_RESORT_S

ROOT = Path(__file__).resolve().parents[1]
# The pages for people listen on all interfaces, unless they are told not to.
LOOPBACK = ('--host', '127.0.0.1', '--dashboard-address', '127.0.0.1:0')


def wait_for(condition):
    """Wait until a condition holds; return its value."""
    limit = time.monotonic() + LAST_RESORT_S
    while not (value := condition()):
        assert time.monotonic() < limit, 'nothing happens'
        time.sleep(0.01)
    return value


def environment(*first, **variables):
    """Return the environment of a process that imports this source tree, after other folders."""
    path = os.pathsep.join(map(str, (*first, ROOT, ROOT / 'test')))
    return {**os.environ, 'PYTHONPATH': path, **variables}


class Cluster:
    """A scheduler and its workers; use it as a context.

    Attributes
    ----------
    address : str
    scheduler : Popen
    workers : list of Popen
        Newest last.
    """

    def __init__(self, folder, **variables):
        self._folder, self._variables = folder, variables
        self._stack = ExitStack()
        self.workers = []

    def __enter__(self):
        self._folder.mkdir(parents=True)
        found = self._folder / 'scheduler.json'
        self.scheduler = self._start(
            ('scheduler', '--port', '0', '--scheduler-file', found),
            environment(**self._variables),
        )
        wait_for(lambda: found.exists() and found.read_text().endswith('}'))
        self.address = json.loads(found.read_text())['address']
        return self

    def __exit__(self, *error):
        self._stack.close()

    def add_worker(self, *first):
        """Start a worker that imports from some folders first."""
        name = f'worker_{len(self.workers)}'
        words = ('worker', self.address, '--nthreads', '1', '--no-nanny', '--name', name)
        words += ('--local-directory', self._folder / name)
        self.workers.append(self._start(words, environment(*first)))
        return self.workers[-1]

    def _start(self, words, variables):
        log = self._stack.enter_context((self._folder / f'{words[0]}.log').open('a'))
        process = subprocess.Popen(
            [sys.executable, '-m', 'dask', *map(str, words), *LOOPBACK],
            cwd=self._folder, env=variables, stdout=log, stderr=log,
        )  # fmt: skip
        self._stack.callback(end, process)
        return process


def end(process):
    """Kill a process: a worker whose scheduler has ended may wait for it long."""
    process.send_signal(signal.SIGKILL)
    process.wait()


@contextmanager
def forked_workers(address, folder, study):
    """Return a function that starts a worker and returns its process id, a hundred times faster."""
    with subprocess.Popen(
        [sys.executable, str(ROOT / 'test/forked_workers.py'), address, str(folder), str(study)],
        env=environment(), stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, bufsize=1,
    ) as program:  # fmt: skip
        processes = []

        def start():
            print(file=program.stdin)
            processes.append(int(program.stdout.readline()))
            return processes[-1]

        try:
            yield start
        finally:
            program.stdin.close()
            program.wait()
