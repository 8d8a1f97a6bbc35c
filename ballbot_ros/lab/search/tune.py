"""Carrying out a tuning: candidates on the same robots, and the best one on others."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ballbot_ros.controllers.design.loop_analysis import dead_time_margin_ms
from ballbot_ros.engine.rows import Column, whole_values
from ballbot_ros.errors import StudyError
from ballbot_ros.lab.search.candidates import (
    joined,
    least_steps,
    run_candidates,
    runs_per_part,
    values_of,
)
from ballbot_ros.lab.search.objective import DEAD_TIME_MARGIN, Verdict
from ballbot_ros.lab.search.optimiser import optimiser_of
from ballbot_ros.lab.search.tuning import Tuning
from ballbot_ros.lab.studies.columns import FALLEN, OUTCOME, MeasureColumn
from ballbot_ros.lab.studies.data_set import MANIFEST
from ballbot_ros.lab.studies.execution import (
    LocalWorkers,
    StudyObserver,
    StudyRun,
    WorkersOfJob,
    run_study,
)
from ballbot_ros.lab.studies.job import Job, job_of
from ballbot_ros.lab.studies.part_file import write_atomically
from ballbot_ros.lab.studies.programs import with_values
from ballbot_ros.lab.studies.runs import Samples
from ballbot_ros.lab.studies.sampling import Sampler
from ballbot_ros.lab.studies.study import Study
from ballbot_ros.lab.studies.study_data import StudyData
from ballbot_ros.parameters import CONTROLLER, DOCUMENTS_PROGRAM, ControllerParameters
from ballbot_ros.parameters.files import plain_values, values_text
from ballbot_ros.robot.arithmetic import Floats

SEARCH, BEFORE, AFTER = 'search', 'before', 'after'
"""Folders of the studies of a tuning: its candidates; robots that it has not seen, twice."""

PARAMETER_FILE = 'tuned.yaml'

WITH_GAINS = ('k_f', 'k_i', 'a_d', 'a_r', 'a_gd')
"""Parameters of the document's program that are of use only together."""

FIRST_STEP = 0.15
"""Standard deviation of the first generation, as a share of the ranges: the start works."""

STEPS = (-0.1, -0.05, -0.02, 0.02, 0.05, 0.1)
"""Changes of each parameter for the sensitivity of the answer, as shares of its range."""


@dataclass(frozen=True)
class TuningResult:
    """What a tuning has found.

    Attributes
    ----------
    points : ndarray, shape (n, d)
        The candidates, as shares of the ranges, in order.
    best : int
        Number of the best candidate.
    around : ndarray, shape (d, s)
        Cost of the best with each parameter changed by each of :data:`STEPS`.
    """

    tuning: Tuning
    folder: Path
    points: Floats
    verdicts: Verdict
    best: int
    around: Floats

    def values(self, candidate: int) -> dict[str, object]:
        """Return the tuned values of a candidate, by ``node.param``."""
        return tuned_values(self.tuning, self.points[candidate])

    def studies(self, which: str) -> list[Path]:
        """Return the folders of one kind of its studies, one for each scenario."""
        return [self.folder / which / _scenario(each) for each in self.tuning.studies]

    def unseen(self) -> Verdict:
        """Return the verdicts of the start and of the best on robots of which none was seen."""
        pairs = []
        for which, candidate in ((BEFORE, 0), (AFTER, self.best)):
            columns = []
            for folder in self.studies(which):
                data = StudyData.open(folder)
                names = [each.name for each in (*data.study.measures, FALLEN, OUTCOME)]
                columns.append(joined(data.parts(names)))
            point = self.points[candidate][None]
            pairs.append(_judge(self.tuning, data.study.measures, columns, point))
        return _joined(pairs)

    @property
    def parameter_file(self) -> Path:
        """The file of the tuned parameters."""
        return self.folder / PARAMETER_FILE


def tuned_values(tuning: Tuning, point: Floats) -> dict[str, object]:
    """Return the values at a point of the unit cube, by ``node.param``."""
    return {name: each[0] for name, each in values_of(tuning.tuned, point[None]).items()}


def run_tuning(
    tuning: Tuning,
    folder: Path,
    observer: StudyObserver,
    workers: WorkersOfJob = LocalWorkers,
    *,
    again: bool = False,
) -> TuningResult:
    """Do what is missing of a tuning in its folder.

    Each candidate is tried on the same robots. The samples depend on the tuning alone, and the
    results of an earlier call take the place of runs, so an interruption changes nothing.

    Raises
    ------
    StudyStoppedError
        If a signal stops it.
    BallbotError
        If the folder is another tuning's or can't be written, a run is not possible, or the
        objective has no value in any run.
    """
    if (folder / MANIFEST).exists():
        raise StudyError(f'{folder}: has a study; choose another --output')
    result = search(tuning, folder, observer, workers, again=again)
    for which, candidate in ((BEFORE, 0), (AFTER, result.best)):
        for each, place in zip(tuning.studies, result.studies(which), strict=True):
            study = _of_unseen(each, result.values(candidate), tuning.unseen)
            job = job_of(study, place)
            observer.generation(f'{which}, on {tuning.unseen:,} robots not seen before')
            run_study(job, observer, workers, again=again)
    write_atomically(result.parameter_file, _parameter_text(result).encode())
    return result


def search(
    tuning: Tuning,
    folder: Path,
    observer: StudyObserver,
    workers: WorkersOfJob = LocalWorkers,
    *,
    again: bool = False,
) -> TuningResult:
    """Try all candidates, and those around the best one; the errors are those of `run_tuning`."""
    population, count = tuning.population, len(tuning.tuned)
    steps = len(STEPS) * count
    more = -(-steps // population)  # generations around the best candidate
    seed = (tuning.studies[0].seed, count)
    optimiser = optimiser_of(
        tuning.method, tuning.start, population, seed, least_steps(tuning.tuned), FIRST_STEP
    )
    points, verdicts = list[Floats](), list[Verdict]()
    with ExitStack() as stack:
        total = population * (tuning.generations + more)
        runs = [
            stack.enter_context(
                StudyRun(_job(tuning, each, folder, total), observer, workers, again=again)
            )
            for each in tuning.studies
        ]
        done = [each.done for each in runs]
        observer.begin(sum(each.runs for each in tuning.studies) * total, sum(done[1:], done[0]))

        def judged(generation: int, chosen: Floats) -> Verdict:
            first = generation * population
            columns = [
                run_candidates(run, _samples(tuning, study, chosen, first * study.runs))
                for run, study in zip(runs, tuning.studies, strict=True)
            ]
            return _judge(tuning, runs[0].job.record.measures, columns, chosen)

        for generation in range(tuning.generations):
            points.append(optimiser.ask())
            verdicts.append(judged(generation, points[-1]))
            if not generation and np.isnan(verdicts[0].value).all():
                raise StudyError(
                    f'{tuning.name}: the objective has no value in any run of the first '
                    f'{population} candidates: all robots fall, or a measure has no value'
                )
            optimiser.tell(verdicts[-1].cost)
            observer.generation(_progress(tuning, generation, verdicts))
        all_points, all_verdicts = np.concatenate(points), _joined(verdicts)
        best = int(np.argmin(all_verdicts.cost))
        near = np.tile(all_points[best], (more * population, 1))
        for number, (variable, step) in enumerate(np.ndindex(count, len(STEPS))):
            changed = all_points[best, variable] + STEPS[step]
            near[number, variable] = np.clip(changed, 0.0, 1.0 - 2.0**-53)
        around = _joined([
            judged(tuning.generations + number, near[number * population :][:population])
            for number in range(more)
        ])  # fmt: skip
        for each in runs:
            each.finish()
    costs = around.cost[:steps].reshape(count, -1)
    return TuningResult(tuning, folder, all_points, all_verdicts, best, costs)


def _job(tuning: Tuning, study: Study, folder: Path, candidates: int) -> Job:
    both = replace(study, variables=(*tuning.tuned, *study.variables), runs=study.runs * candidates)
    part = runs_per_part(study, tuning.population, study.runs)
    return job_of(both, folder / SEARCH / _scenario(study), part)


def _scenario(study: Study) -> str:
    """Return the part of a path that distinguishes the study of a scenario from others."""
    return study.case.get('scenario', '')


def _samples(tuning: Tuning, study: Study, points: Floats, first: int) -> Samples:
    """Return the samples of candidates: each is tried on all robots of a study."""
    robots = Sampler(study).part(0, study.runs)
    tuned = values_of(tuning.tuned, points)

    def of_all(columns: Mapping[str, Column]) -> dict[str, Column]:
        return {name: np.tile(column, len(points)) for name, column in columns.items()}

    values = {name: np.repeat(column, study.runs) for name, column in tuned.items()}
    return Samples(
        len(points) * study.runs,
        {**values, **of_all(robots.values)},
        of_all(robots.events),
        first,
    )


def _judge(
    tuning: Tuning,
    measures: Sequence[MeasureColumn],
    columns: Sequence[Mapping[str, Column]],
    points: Floats,
) -> Verdict:
    """Judge candidates by the columns of their runs in each scenario."""
    joined = {
        name: np.concatenate([each[name].reshape(len(points), -1) for each in columns], axis=1)
        for name in columns[0]
        if all(name in each for each in columns)  # scenarios can have measures of their own
    }
    margins = None
    if any(each.name == DEAD_TIME_MARGIN for each in tuning.objective.limits):
        parameters = tuning.studies[0].spec.parameters
        margins = np.array([
            dead_time_margin_ms(with_values(parameters, tuned_values(tuning, each)))
            for each in points
        ])  # fmt: skip
    return tuning.objective.judge(measures, joined, margins)


def _joined(verdicts: Sequence[Verdict]) -> Verdict:
    return Verdict(*(np.concatenate(each) for each in zip(*verdicts, strict=True)))


def _progress(tuning: Tuning, generation: int, verdicts: Sequence[Verdict]) -> str:
    """Return how far a search is: generation, best value, and spread of the last generation."""
    joined, last = _joined(verdicts), verdicts[-1]
    best = joined.value[int(np.argmin(joined.cost))]
    spread = np.nanstd(last.value) if not np.isnan(last.value).all() else np.nan
    text = f'generation {generation + 1}/{tuning.generations}  best {best:.4g} ± {spread:.2g}'
    return text if joined.is_feasible.any() else f'{text}, breaks a limit'


def _of_unseen(study: Study, values: Mapping[str, object], runs: int) -> Study:
    """Return a study of other robots with the values of a candidate."""
    parameters = with_values(study.spec.parameters, values)
    spec = replace(study.spec, parameters=parameters)
    return replace(study, spec=spec, runs=runs, seed=study.seed + 1)


def _parameter_text(result: TuningResult) -> str:
    """Return the text of the parameter file: what is tuned, and what it needs."""
    tuning, study = result.tuning, result.tuning.studies[0]
    parameters = study.spec.parameters
    controller = parameters.of(ControllerParameters)
    values: dict[str, Any] = {'implementation': controller.implementation, **parameters.undeclared}
    if controller.implementation in DOCUMENTS_PROGRAM:
        values = {name: getattr(controller, name) for name in WITH_GAINS}
    wholes = whole_values(parameters, plain_values(result.values(result.best)))
    values |= {name.partition('.')[2]: each for name, each in wholes.items()}
    value = float(result.verdicts.value[result.best])
    about = f'# ballbot tune {tuning.name}: objective {value:.6g} over {study.runs} robots\n'
    return about + values_text({CONTROLLER: values})
