"""Falsification: a search of a study's variation for runs that violate its requirements."""

from __future__ import annotations

import shutil
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ballbot_ros.engine.rows import Column
from ballbot_ros.engine.scenario.formulas import Interval
from ballbot_ros.engine.scenario.properties import CLEARANCE
from ballbot_ros.errors import BallbotError, StudyError
from ballbot_ros.lab.search.candidates import (
    has_value,
    least_steps,
    run_candidates,
    runs_per_part,
    share_of,
    values_of,
)
from ballbot_ros.lab.search.optimiser import Method, Optimiser, optimiser_of
from ballbot_ros.lab.search.shrinking import Case, deviations, shrunk
from ballbot_ros.lab.studies.columns import PASSED, MeasureColumn
from ballbot_ros.lab.studies.execution import (
    LocalWorkers,
    StudyObserver,
    StudyRun,
    StudyStoppedError,
    WorkersOfJob,
    call_safely,
)
from ballbot_ros.lab.studies.job import Job, job_of
from ballbot_ros.lab.studies.rerun import scenario_spec
from ballbot_ros.lab.studies.runs import Results, Samples
from ballbot_ros.lab.studies.sampling import seeds_of_runs
from ballbot_ros.lab.studies.study import Study
from ballbot_ros.lab.studies.study_data import RunResults
from ballbot_ros.lab.studies.variables import SEED, nominal_value
from ballbot_ros.lockstep.run_actions import Outcome
from ballbot_ros.parameters import ControllerParameters
from ballbot_ros.parameters.files import plain_value
from ballbot_ros.robot.arithmetic import Floats
from ballbot_ros.run.execution import execute
from ballbot_ros.run.requirements import Processes

POPULATION, MOST_RUNS = 8, 1_000_000
FIRST_STEP = 0.3
"""Standard deviation of the first generation, as a share of the ranges: failures are far away."""

COUNTEREXAMPLES = 'counterexamples'
COMPLETED = 'completed'
"""Name of the requirement that no wall hit and no fault of the controller ends a run."""

_RANGES = {
    **{f'duty_{plane}_percent': Interval(-100.0, 100.0) for plane in 'xy'},
    CLEARANCE: Interval(0.0, np.inf),
}
_NO_VALUE = 1e9


@dataclass(frozen=True)
class Falsification:
    """A search in a study, whose runs are the budget, for a wanted number of counterexamples."""

    study: Study
    wanted: int
    method: Method = Method.CMA


@dataclass(frozen=True)
class Counterexample:
    """A run that violates a requirement.

    Attributes
    ----------
    number : int
        Number of the run in the study.
    requirement : str
        Name of the measure, or :data:`COMPLETED`.
    found : mapping of str to value
        What varied in this run.
    shrunk : Case
        A simpler run that still violates it.
    deviations : tuple of str
        The variables that still differ from their nominal values.
    scenario : Path or None
        File of the simpler run; None if it was not reproduced.
    seed : int
        Of the noise of its devices.
    duty_sha256 : str
        Hash of the duties of the simpler run.
    is_same : bool
        Whether its recording has this hash.
    """

    number: int
    requirement: str
    found: Mapping[str, Any]
    shrunk: Case
    deviations: tuple[str, ...]
    seed: int
    duty_sha256: str = ''
    scenario: Path | None = None
    is_same: bool = False


@dataclass(frozen=True)
class FalsificationResult:
    """What a falsification has found: of how many `runs` how many are `violating`.

    `least` has the lowest robustness of each requirement, infinite without a value.
    """

    of: Falsification
    folder: Path
    runs: int
    violating: int
    least: Mapping[str, float]
    counterexamples: list[Counterexample]


def check(study: Study) -> None:
    """Refuse a study that can't be searched.

    It raises StudyError if it requires nothing, a property can't be violated, only the seed varies,
    gains are designed, or it has too many runs.
    """
    if study.runs > MOST_RUNS:
        raise StudyError(f'{study.name}: {study.runs:,} runs; at most {MOST_RUNS:,} are searched')
    if not study.variables:
        raise StudyError(f'{study.name}: nothing varies but the seed; there is nothing to search')
    if study.redesign:
        raise StudyError(f'{study.name}: a search needs the same gains in all runs: omit redesign')
    if not requirements_of(study):
        raise StudyError(
            f'{study.name}: has neither properties nor expectations that a run could violate'
        )
    for each in study.properties:
        if each.formula.bounds(_RANGES).low >= 0.0:
            raise StudyError(
                f'{study.name}: {each.name!r}: nothing can violate it, whatever the signals: '
                f'{each.text}'
            )


def requirements_of(study: Study) -> list[MeasureColumn]:
    """Return the measures that have bounds."""
    columns = study.measure_columns
    return [each for each in columns if each.minimum is not None or each.maximum is not None]


def robustness(column: MeasureColumn, values: Floats) -> Floats:
    """Return how far values are within their bounds; NaN remains NaN."""
    low = np.inf if column.minimum is None else values - column.minimum
    high = np.inf if column.maximum is None else column.maximum - values
    return np.minimum(low, high)


def run_falsification(
    falsification: Falsification,
    folder: Path,
    observer: StudyObserver,
    workers: WorkersOfJob = LocalWorkers,
    processes: Processes = Processes.SEPARATE,
    *,
    again: bool = False,
) -> FalsificationResult:
    """Search, shrink what is found, and record it as runs of the graph.

    Each requirement is searched in turn, a generation at a time; after a counterexample its search
    begins elsewhere. The search does not depend on the workers, and results of an earlier call take
    the place of runs.

    Raises
    ------
    StudyStoppedError
        If a signal stops it.
    BallbotError
        If the folder is another study's or can't be written, a run is not possible, or a
        requirement has no value in any run.
    """
    job = job_for(falsification.study, folder)
    result = search(falsification, folder, observer, workers, again=again)
    place = folder / COUNTEREXAMPLES
    shutil.rmtree(place, ignore_errors=True)
    found: list[Counterexample] = []
    for rank, each in enumerate(result.counterexamples, 1):
        observer.generation(f'counterexample {rank}: shrinking and recording')
        simpler = _shrunk(job, each)
        found.append(_recorded(job, simpler, place / str(rank), processes))
    return replace(result, counterexamples=found)


def job_for(study: Study, folder: Path) -> Job:
    """Return the job of a study that is searched."""
    return job_of(study, folder, runs_per_part(study, POPULATION, 1))


def search(
    falsification: Falsification,
    folder: Path,
    observer: StudyObserver,
    workers: WorkersOfJob = LocalWorkers,
    *,
    again: bool = False,
) -> FalsificationResult:
    """Return what is found in the runs, generation by generation; nothing is made simpler.

    The errors are those of :func:`run_falsification`.
    """
    study = falsification.study
    job, columns = job_for(study, folder), requirements_of(study)
    optimisers = [_optimiser(falsification, number, 0) for number in range(len(columns))]
    restarts, turns, tried = [0] * len(columns), deque(range(len(columns))), set[int]()
    least = {each.name: np.inf for each in columns}
    found: list[Counterexample] = []
    done = violating = 0
    with StudyRun(job, observer, workers, again=again) as run:
        observer.begin(study.runs, run.done)
        while turns and done < study.runs and len(found) < falsification.wanted:
            turn = turns.popleft()
            count = min(POPULATION, study.runs - done)
            points = optimisers[turn].ask()
            results = run_candidates(run, _samples(study, points[:count], done))
            values = [robustness(each, results[each.name]) for each in columns]
            if not done:
                _check_values(study, columns, values)
            fault = '' if turn in tried else _why_fixed(columns[turn], values[turn])
            tried.add(turn)
            if not fault:
                turns.append(turn)
            elif turns or found:
                observer.notice(f'{columns[turn].name!r} is not searched: {fault}')
            else:
                raise StudyError(f'{study.name}: {columns[turn].name!r}: {fault}')
            for each, of_runs in zip(columns, values, strict=True):
                least[each.name] = float(np.fmin.reduce(of_runs, initial=least[each.name]))
            violating += int((~results[PASSED.name]).sum())
            if (~results[PASSED.name]).any():
                found.append(_worst(study, columns, values, results, done, turn))
                # Elsewhere, for another counterexample.
                restarts[turn] += 1
                optimisers[turn] = _optimiser(falsification, turn, restarts[turn])
            elif count == POPULATION:
                optimisers[turn].tell(np.nan_to_num(values[turn], nan=_NO_VALUE))
            done += count
            lowest = min(least.values())
            observer.generation(f'lowest robustness {lowest:.3g}, {len(found)} found')
        if done >= study.runs:
            run.finish()
    return FalsificationResult(falsification, job.folder, done, violating, least, found)


def _optimiser(falsification: Falsification, requirement: int, restart: int) -> Optimiser:
    """Return what searches for violations of a requirement: first around the nominal values."""
    study = falsification.study
    seed = study.seed, requirement, restart
    start = np.random.default_rng(seed).random(len(study.variables))
    for number, each in enumerate(study.variables) if not restart else ():
        nominal = nominal_value(study.spec, each)
        if has_value(each.distribution, nominal):
            start[number] = share_of(each.distribution, nominal)
    steps = least_steps(study.variables)
    return optimiser_of(falsification.method, start, POPULATION, seed, steps, FIRST_STEP)


def _samples(study: Study, points: Floats, first: int) -> Samples:
    columns = values_of(study.variables, points)
    if study.draws_seeds:
        columns[SEED] = seeds_of_runs(study.seed, first, first + len(points))
    return study.samples(columns, first)


def _check_values(study: Study, columns: Sequence[MeasureColumn], values: Sequence[Floats]) -> None:
    """Raise StudyError if a requirement has no value in any of the first runs."""
    for each, of_runs in zip(columns, values, strict=True):
        if np.isnan(of_runs).all():
            raise StudyError(
                f'{study.name}: {each.name!r} has no value in any of the first {len(of_runs)} runs'
            )


def _why_fixed(column: MeasureColumn, values: Floats) -> str:
    """Return why nothing that varies can violate a requirement, given its first runs, or ''."""
    if len(values) == 1 or np.ptp(values) > 0.0 or not values[0] >= 0.0:
        return ''
    return (
        f'it is {values[0]:.4g} {column.unit} from a violation in all of the first {len(values)} '
        'runs: nothing that varies changes it'
    )


def _worst(
    study: Study,
    columns: Sequence[MeasureColumn],
    values: Sequence[Floats],
    results: Mapping[str, Column],
    first: int,
    turn: int,
) -> Counterexample:
    """Return the run of a generation that violates a requirement most: that of the turn first."""
    order = [turn, *(number for number in range(len(columns)) if number != turn)]
    for number in order:
        of_runs = np.nan_to_num(values[number], nan=np.inf)
        if of_runs.min() < 0.0:
            run, name = int(np.argmin(of_runs)), columns[number].name
            break
    else:  # the run failed, or lacks a value; which, its repetition tells
        run, name = int(np.argmin(results[PASSED.name])), ''
    case = {each.name: plain_value(results[each.name][run]) for each in study.variables}
    number = first + run
    drawn = seeds_of_runs(study.seed, number, number + 1)[0]
    seed = int(drawn) if study.draws_seeds else study.spec.plant.seed
    return Counterexample(number, name, case, case, (), seed)


def _shrunk(job: Job, found: Counterexample) -> Counterexample:
    """Return a counterexample with a simpler run."""
    study = job.study
    nominal = {each.name: nominal_value(study.spec, each) for each in study.variables}

    (results,) = _simulated(job, found.number, [dict(found.found)])
    assert results is not None
    names = [COMPLETED, *(each.name for each in requirements_of(study))]
    requirement = found.requirement or next(n for n in names if _violates(job, n, results))

    def violates(cases: Sequence[Case]) -> list[bool]:
        results = _simulated(job, found.number, cases)
        return [each is not None and _violates(job, requirement, each) for each in results]

    case = shrunk(dict(found.found), study.variables, nominal, violates)
    (results,) = _simulated(job, found.number, [case])
    assert results is not None
    return replace(
        found,
        requirement=requirement,
        shrunk=case,
        deviations=deviations(case, study.variables, nominal),
        duty_sha256=results.duty_sha256[0].tobytes().hex(),
    )


def _simulated(job: Job, number: int, cases: Sequence[Case]) -> list[Results | None]:
    """Return the results of runs with the seed of a run; None of one that is not possible."""
    study = job.study
    columns = {name: np.array([each[name] for each in cases]) for name in cases[0]}
    if study.draws_seeds:
        columns[SEED] = np.repeat(seeds_of_runs(study.seed, number, number + 1), len(cases))
    try:
        results = call_safely(Job.simulate, job, study.samples(columns, number))
    except BallbotError:
        if len(cases) == 1:
            return [None]
        return [_simulated(job, number, [each])[0] for each in cases]
    return [results.part(slice(run, run + 1)) for run in range(len(cases))]


def _violates(job: Job, requirement: str, results: Results) -> bool:
    """Return whether a run violates a requirement."""
    if requirement == COMPLETED:
        return bool(results.failed[0])
    place = [each.name for each in job.record.measures].index(requirement)
    value = robustness(job.record.measures[place], results.measured[0, place : place + 1])[0]
    return not value >= 0.0  # as in a study, what has no value does not hold


def _recorded(
    job: Job,
    found: Counterexample,
    folder: Path,
    processes: Processes,
) -> Counterexample:
    """Write the scenario of a counterexample, and record it."""
    row = RunResults(
        found.number, found.shrunk.get(SEED, found.seed), found.shrunk, {}, passed=False,
        outcome=Outcome.COMPLETED, fallen=False, ticks=0, duty_sha256=found.duty_sha256,
    )  # fmt: skip
    # The user has chosen it, be it by the study.
    controller = job.spec.parameters.of(ControllerParameters).implementation
    path, spec = scenario_spec(job.record, row, folder, processes, controller)
    result = execute(spec)
    if result.outcome is Outcome.STOPPED:
        raise StudyStoppedError(result.failure_status - 128)
    return replace(
        found,
        scenario=path,
        is_same=result.duty_sha256 == found.duty_sha256,
    )
