"""The runs of candidates, generation by generation, as parts of a study."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ballbot_ros.engine.rows import Column
from ballbot_ros.errors import StudyError
from ballbot_ros.lab.studies.columns import FALLEN, OUTCOME, PASSED
from ballbot_ros.lab.studies.execution import StudyRun
from ballbot_ros.lab.studies.part_file import PARTS, read_columns
from ballbot_ros.lab.studies.programs import why_not_compiled
from ballbot_ros.lab.studies.runs import Samples
from ballbot_ros.lab.studies.study import Study
from ballbot_ros.lab.studies.variables import Distribution, Levels, Variable, WholeNumbers
from ballbot_ros.lockstep.run_actions import Outcome
from ballbot_ros.robot.arithmetic import Floats

PART_S = 4_000.0
"""Most sim time of the compiled runs of a part [s]: half a second of work on a core."""

FEWEST_PARTS = 4
"""Parts of a generation, so that several cores have work."""

_HALVINGS = 60


def run_candidates(run: StudyRun, samples: Samples) -> dict[str, Column]:
    """Do what is missing of a generation, parts of a study, and return columns of its results.

    Raises
    ------
    StudyStoppedError
        If a signal stops it.
    BallbotError
        If a run is not possible, or results can't be written or read.
    """
    record, first = run.job.record, samples.first
    begin = first // record.runs_per_part
    parts = range(begin, begin + -(-samples.count // record.runs_per_part))
    missing = [part for part in parts if part in run.missing]
    run.do(missing, lambda low, high: samples.part(low - first, high - first))
    varied = [each.name for each in record.varied]
    names = [*varied, *(each.name for each in record.measures), PASSED.name, FALLEN.name]
    files = [run.job.folder / PARTS / record.part_name(part) for part in parts]
    columns = joined(
        read_columns(file, record, part, [*names, OUTCOME.name])
        for file, part in zip(files, parts, strict=True)
    )
    asked = {**samples.values, **samples.events}
    for name in varied:
        if not np.array_equal(columns[name], asked[name]):
            raise StudyError(
                f'{run.job.folder}: its candidates differ from those of this machine; go on where '
                'it began, or give --again'
            )
    return columns


def joined(parts: Iterable[Mapping[str, Column]]) -> dict[str, Column]:
    """Return the columns of all parts, that of the outcome as whether runs failed."""
    every = list(parts)
    columns = {name: np.concatenate([each[name] for each in every]) for name in every[0]}
    columns[OUTCOME.name] = columns[OUTCOME.name] == Outcome.FAILED
    return columns


def runs_per_part(study: Study, population: int, runs_each: int) -> int:
    """Return how many runs a part has: those of whole candidates, in parts of equal size."""
    _, longest = study.common_scenario
    work_s = population * runs_each * longest.duration
    divisors = [each for each in range(1, population + 1) if population % each == 0]
    enough = [each for each in divisors if each >= FEWEST_PARTS and work_s / each <= PART_S]
    parts = population if why_not_compiled(study.spec) or not enough else enough[0]
    return population // parts * runs_each


def values_of(variables: Sequence[Variable], points: Floats) -> dict[str, Column]:
    """Return the values of variables at points of the unit cube, (n, d), by name."""
    return {
        each.name: each.distribution.values(points[:, number])
        for number, each in enumerate(variables)
    }


def has_value(distribution: Distribution, value: Any) -> bool:
    """Return whether a value can be drawn; None can't."""
    if isinstance(distribution, Levels):
        return value in distribution.levels
    low, high = distribution.ends
    return value is not None and bool(low <= value <= high)


def share_of(distribution: Distribution, value: object) -> float:
    """Return a share within [0, 1) that has a value, which can be drawn."""
    if isinstance(distribution, Levels):
        return (distribution.levels.index(value) + 0.5) / len(distribution.levels)
    low, high = 0.0, 1.0
    if value == distribution.values(np.array([low]))[0]:
        return low
    for _ in range(_HALVINGS):
        middle = (low + high) / 2.0
        if distribution.values(np.array([middle]))[0] < value:
            low = middle
        else:
            high = middle
    return min(high, 1.0 - 2.0**-53)


def least_steps(variables: Sequence[Variable]) -> NDArray[np.float64]:
    """Return the smallest useful steps of variables in the unit cube: those of discrete values."""
    counts = []
    for each in variables:
        of = each.distribution
        if isinstance(of, Levels):
            counts.append(float(len(of.levels)))
        elif isinstance(of, WholeNumbers):
            counts.append(float(of.high - of.low + 1))
        else:
            counts.append(np.inf)
    return 0.3 / np.array(counts)
