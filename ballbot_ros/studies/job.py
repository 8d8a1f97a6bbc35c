"""A part of a study: simulated, judged and written."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from threading import Lock

import numpy as np
from numpy.typing import NDArray

from ballbot_ros.run.spec import RunSpec
from ballbot_ros.scenario.scenario import Expectation, Measure
from ballbot_ros.studies.columns import Column, ColumnKind, MeasureColumn
from ballbot_ros.studies.manifest import PartSummary, StudyRecord
from ballbot_ros.studies.part_file import EncodedPart, PartRows, encode_part, store_part
from ballbot_ros.studies.rerun import parameter_text, scenario_text
from ballbot_ros.studies.runs import (
    Advance,
    Results,
    Samples,
    Simulator,
    ignore,
    is_compiled,
    simulator_for,
)
from ballbot_ros.studies.study import Study
from ballbot_ros.studies.variables import SEED
from ballbot_ros.world.library import read_map_file

COMPILED_PART_S, ORDINARY_PART_S = 50_000.0, 500.0
"""Sim time of the runs of a part [s]: some seconds of work on a core."""

FEWEST_PARTS, MOST_PARTS = 16, 50_000
"""Parts of a study with very few, or very many, runs."""


@dataclass(frozen=True)
class Job:
    """All that a worker needs to do any part of a study, but for the samples.

    Attributes
    ----------
    record : StudyRecord
        The study.
    spec : RunSpec
        The run that all are like, but for their samples.
    measures : tuple of Measure
        What is measured, in the order of the record's columns.
    expectations : tuple of Expectation
        Their measures are among those.
    folder : Path
        Where the part is written.
    """

    record: StudyRecord
    spec: RunSpec
    measures: tuple[Measure, ...]
    expectations: tuple[Expectation, ...]
    folder: Path

    def do(self, part: int, samples: Samples, advance: Advance = ignore) -> PartSummary:
        """Simulate, judge and write a part.

        Raises
        ------
        BallbotError
            If a value is not possible, or the part can't be written; the message is one line.
        """
        return self.store(part, self.encode(part, samples, advance))

    def store(self, part: int, encoded: EncodedPart) -> PartSummary:
        """Write a part; StudyError if it can't be written."""
        store_part(self.folder, self.record, part, encoded.data)
        return encoded.summary

    def encode(self, part: int, samples: Samples, advance: Advance = ignore) -> EncodedPart:
        """Simulate and judge a part, and return the bytes of its file.

        Raises
        ------
        BallbotError
            If a value is not possible; the message is one line.
        """
        results = _simulator(self).simulate(samples, advance)
        varied = {**samples.values, **samples.events}
        seeds = varied.get(SEED, np.full(samples.count, self.spec.plant.seed))
        rows = PartRows(
            seeds.astype(np.int64),
            [varied[each.name] for each in self.record.varied],
            results,
            passed(results, self.measures, self.expectations),
        )
        return encode_part(self.record, part, rows)


def job_of(study: Study, folder: Path) -> Job:
    """Return the job of a study whose results are in a folder.

    Raises
    ------
    BallbotError
        If the map can't be read.
    """
    spec = replace(study.spec, controller=None)
    record = StudyRecord.of_this_code(
        study.name,
        text=study.text,
        scenario=scenario_text(*study.common_scenario),
        parameters=parameter_text(spec.parameters) + _identities(study.spec),
        runs=study.runs,
        seed=study.seed,
        runs_per_part=_runs_per_part(study),
        varied=tuple(
            Column(
                each.name,
                ColumnKind.of(each.distribution.values(np.zeros(1))),
                each.unit,
                each.parameter.description,
            )
            for each in study.variables
        ),
        measures=tuple(MeasureColumn.of(each, study.expectations) for each in study.measures),
    )
    return Job(record, spec, study.measures, study.expectations, folder)


def _identities(spec: RunSpec) -> str:
    """Return comments that name the content of files which a run depends on."""
    lines = []
    if spec.plant.map:
        digest = hashlib.sha256(read_map_file(spec.plant.map)).hexdigest()
        lines.append(f'# map {spec.plant.map}: SHA-256 {digest}\n')
    if spec.controller:
        # Imported here, because it takes 0.2 s.
        from ballbot_ros.analysis.recorded_controller import ControllerIdentity

        lines.append(f'# controller: SHA-256 {ControllerIdentity.of(spec.controller).sha256}\n')
    return ''.join(lines)


def _runs_per_part(study: Study) -> int:
    """Return how many runs a part has: a few seconds of work, but some parts for every core."""
    work_s = COMPILED_PART_S if is_compiled(study.spec) else ORDINARY_PART_S
    _, longest = study.common_scenario
    runs = min(work_s / longest.duration, study.runs / FEWEST_PARTS)
    return max(1, round(runs), -(-study.runs // MOST_PARTS))


def passed(
    results: Results, measures: Sequence[Measure], expectations: Sequence[Expectation]
) -> NDArray[np.bool_]:
    """Return for each run whether it was completed and all expectations hold."""
    good = ~results.failed
    for each in expectations:
        good &= each.holds(results.measured[:, measures.index(each.measure)])
    return good


_simulators: dict[str, Simulator] = {}
_making = Lock()


def _simulator(job: Job) -> Simulator:
    """Return the simulator of a study; the last one made is kept, for all threads."""
    identity = job.record.identity
    with _making:
        if identity not in _simulators:
            _simulators.clear()
            _simulators[identity] = simulator_for(job.spec, job.measures)
        return _simulators[identity]
