"""Searches by CMA-ES and at random, for the table of docs/search.md."""

from __future__ import annotations

import tempfile
from concurrent.futures import Future
from dataclasses import replace
from pathlib import Path
from statistics import median
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ballbot_ros.lab.search import falsify, tune
from ballbot_ros.lab.search.falsify import Falsification
from ballbot_ros.lab.search.optimiser import Method
from ballbot_ros.lab.search.tuning import Tuning, read_tuning
from ballbot_ros.lab.studies.execution import StudyObserver
from ballbot_ros.lab.studies.job import Job
from ballbot_ros.lab.studies.manifest import PartSummary
from ballbot_ros.lab.studies.reader import read_study
from ballbot_ros.lab.studies.runs import Samples
from ballbot_ros.robot.arithmetic import Floats
from benchmark.tables import print_table

ROOT = Path(__file__).parents[3]
SEEDS = 20
CANDIDATES, ROBOTS = 200, 8
"""Of each tuning; the shipped files have more."""

BUDGET = 20_000
"""Most runs of a falsification."""

TUNINGS = ('quiet', 'python'), ('robust', 'python'), ('fast', 'pid'), ('quiet', 'lqg')
FALSIFICATIONS = 'sign_error', 'unlimited_integrator', 'stale_sonar', 'full_stick'


class _Here:
    """Does parts in this thread: the defective controllers are this project's own."""

    count = 1

    def __init__(self, job: Job, observer: StudyObserver) -> None:
        self._job = job

    def submit(self, part: int, samples: Samples) -> Future[PartSummary]:
        done: Future[PartSummary] = Future()
        done.set_result(self._job.do(part, samples))
        return done

    def close(self) -> None:
        """End nothing."""


class _Row(NamedTuple):
    problem: str
    needed: dict[Method, float]


def searches() -> None:
    """Compare the runs that CMA-ES and random search need, in the median."""
    rows = [_tuning(*each) for each in TUNINGS]
    rows += [_falsification(each) for each in FALSIFICATIONS]
    table = [
        [
            row.problem,
            f'{row.needed[Method.RANDOM]:,.0f}',
            f'{row.needed[Method.CMA]:,.0f}',
            f'{row.needed[Method.CMA] / row.needed[Method.RANDOM]:.2f}',
        ]
        for row in rows
    ]
    print_table(['problem', 'random', 'CMA-ES', 'ratio'], table)


def _tuning(name: str, controller: str) -> _Row:
    """Return the runs until a tuning is as good as random search with its whole budget."""
    read = read_tuning(name, CANDIDATES, controller=controller)
    costs = {
        method: np.array([_costs(read, method, seed) for seed in range(1, SEEDS + 1)])
        for method in Method
    }
    quality = float(np.median(costs[Method.RANDOM][:, -1]))
    needed = {method: _until(costs[method] <= quality) * ROBOTS for method in Method}
    return _Row(f'tune {name}, {controller}', needed)


def _costs(read: Tuning, method: Method, seed: int) -> Floats:
    """Return the lowest cost after each candidate."""
    studies = tuple(replace(each, runs=ROBOTS, seed=seed) for each in read.studies)
    tuning = replace(read, studies=studies, method=method)
    with tempfile.TemporaryDirectory() as folder:
        verdicts = tune.search(tuning, Path(folder) / 'search', StudyObserver()).verdicts
    return np.minimum.accumulate(verdicts.cost)


def _until(reached: NDArray[np.bool_]) -> float:
    """Return the median number of candidates until a quality; all of them where it never comes."""
    first = np.where(reached.any(axis=1), reached.argmax(axis=1) + 1, reached.shape[1])
    return float(np.median(first))


def _falsification(name: str) -> _Row:
    """Return the runs until the first counterexample."""
    study = read_study(str(ROOT / f'docs/examples/defects/{name}.yaml'), runs=BUDGET)

    def runs(method: Method, seed: int) -> int:
        searched = Falsification(replace(study, seed=seed), 1, method)
        with tempfile.TemporaryDirectory() as folder:
            result = falsify.search(searched, Path(folder) / 'search', StudyObserver(), _Here)
        return result.counterexamples[0].number + 1 if result.counterexamples else BUDGET

    return _Row(f'falsify {name}', {
        method: median(runs(method, seed) for seed in range(1, SEEDS + 1)) for method in Method
    })  # fmt: skip
