"""Simulated trials: the whole protocol of a run in one process, thousands of times a minute.

A trial is a function of seed and number. The world and the faults are in ``test/protocol_world.py``
and ``test/protocol_trials.py``, which the test suite uses as well.
"""

from __future__ import annotations

import os
import time
import traceback
from collections.abc import Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from multiprocessing import get_context
from pathlib import Path
from types import SimpleNamespace
from typing import NamedTuple

from protocol_trials import FAULTS, LIMIT_S, Trial, Violation
from rich.console import Console

from ballbot_ros.process import StopRequest
from campaign.fault import Verdict
from campaign.schedule import table_of

CHUNK = 50
"""Trials that a worker runs before it returns their results."""

REPORT_S = 10.0
"""Period of the progress lines [s]."""

UNDISTURBED = 'no fault'

MAX_TOLD = 10
"""Number of failed trials that are printed and kept."""


class Result(NamedTuple):
    """Result of a simulated trial; `took_s` is virtual time from the first fault to its end [s]."""

    number: int
    faults: tuple[str, ...]
    failure: str
    took_s: float


def carry_out(seed: int, number: int, kept: Path | None = None) -> tuple[Result, str]:
    """Run a trial; return the result and the hash of its events, which `kept` gets as text."""
    trial = Trial(seed, number, keeps_log=kept is not None)
    failure = ''
    try:
        trial.run()
    except Violation as error:
        failure = str(error)
    except Exception:
        failure = traceback.format_exc()
    if kept:
        kept.parent.mkdir(parents=True, exist_ok=True)
        kept.write_text(''.join(trial.world.log or ()))
    kinds = tuple(dict.fromkeys(fault.kind for fault in trial.faults))
    return Result(number, kinds, failure, trial.took_s), trial.world.log_sha256


def carry_out_some(seed: int, first: int) -> list[Result]:
    """Run the next trials from number `first` on."""
    return [carry_out(seed, number)[0] for number in range(first, first + CHUNK)]


class SimulatedCampaign:
    """Runs simulated trials on all cores.

    Attributes
    ----------
    failures : list of Result
        The trials in which something did not hold.
    """

    def __init__(self, seed: int, output: Path, console: Console, stop: StopRequest) -> None:
        self.failures: list[Result] = []
        self._seed, self._output, self._console, self._stop = seed, output, console, stop
        self._verdicts: dict[str, list[Verdict]] = {}
        self._count = 0

    def follow(self, length_s: float) -> None:
        """Run trials for a time [s]."""
        begun_s = reported_s = time.monotonic()
        for results in self._results(begun_s + length_s):
            for result in results:
                self._take(result)
            if time.monotonic() - reported_s > REPORT_S:
                reported_s = time.monotonic()
                self._report(reported_s - begun_s)
        self._report(time.monotonic() - begun_s)

    def _results(self, end_s: float) -> Iterator[list[Result]]:
        workers = len(os.sched_getaffinity(0))
        numbers = iter(range(0, 10**12, CHUNK))
        waiting: set[Future[list[Result]]] = set()
        # Not forked: the command has threads.
        with ProcessPoolExecutor(workers, get_context('spawn')) as pool:
            while True:
                while (
                    len(waiting) < 2 * workers
                    and time.monotonic() < end_s
                    and not self._stop.signal
                ):
                    waiting.add(pool.submit(carry_out_some, self._seed, next(numbers)))
                if not waiting:
                    return
                done, waiting = wait(waiting, return_when=FIRST_COMPLETED)
                yield from (each.result() for each in done)

    def follow_one(self, number: int) -> None:
        """Run one trial, and keep its events."""
        path = self._output / f'trial_{number}.txt'
        result, log_sha256 = carry_out(self._seed, number, path)
        self._take(result)
        faults = ', '.join(result.faults) or UNDISTURBED
        mark = '[red]did not hold[/]' if result.failure else '[green]held[/]'
        self._console.print(f'{mark}  {faults}; events {log_sha256}, in {path}', soft_wrap=True)

    def _take(self, result: Result) -> None:
        self._count += 1
        verdict = Verdict((result.failure,) if result.failure else (), result.took_s, LIMIT_S)
        for kind in result.faults or (UNDISTURBED,):
            self._verdicts.setdefault(kind, []).append(verdict)
        if result.failure:
            self.failures.append(result)
            if len(self.failures) <= MAX_TOLD:
                faults = ', '.join(result.faults) or UNDISTURBED
                self._console.print(f'[red]did not hold[/]  trial {result.number}: {faults}')
                self._console.print(f'  {result.failure}', markup=False, soft_wrap=True)

    def _report(self, now_s: float) -> None:
        rate = round(60.0 * self._count / max(now_s, 1e-3))
        held = self._count - len(self.failures)
        line = f'{now_s:5.0f} s  {held} of {self._count} trials held, {rate} per minute'
        self._console.print(line, highlight=False)

    def print_summary(self) -> None:
        """Print the table of faults, and the commands that repeat the failed trials."""
        kinds = [SimpleNamespace(name=name) for name in (*FAULTS, UNDISTURBED)]
        self._console.print(table_of(kinds, self._verdicts, ()))
        for failure in self.failures[:MAX_TOLD]:
            words = f'--simulated --seed {self._seed} --trial {failure.number}'
            self._console.print(f'  scripts/campaign {words}', soft_wrap=True, markup=False)
