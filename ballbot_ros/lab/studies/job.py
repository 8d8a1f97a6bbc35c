"""A part of a study: simulated, judged and written."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from threading import Lock
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ballbot_ros.controllers.loading import find_code, is_file_reference
from ballbot_ros.engine.scenario.properties import Property
from ballbot_ros.engine.scenario.scenario import Expectation, Measure
from ballbot_ros.engine.scenario.writer import scenario_data
from ballbot_ros.errors import StudyError, os_errors
from ballbot_ros.lab.studies.columns import ColumnKind, ResultColumn
from ballbot_ros.lab.studies.manifest import PartSummary, StudyRecord
from ballbot_ros.lab.studies.part_file import EncodedPart, encode_part, store_part, write_atomically
from ballbot_ros.lab.studies.programs import why_not_compiled
from ballbot_ros.lab.studies.rerun import parameter_text
from ballbot_ros.lab.studies.runs import Advance, Results, Samples, Simulator, ignore, simulator_for
from ballbot_ros.lab.studies.study import GAINS, Study
from ballbot_ros.lab.studies.variables import SEED
from ballbot_ros.lockstep.run_actions import Outcome
from ballbot_ros.parameters import (
    CONTROLLER,
    DOCUMENTS_PROGRAM,
    PLANT,
    ControllerParameters,
    ParameterSet,
)
from ballbot_ros.parameters.yaml_document import yaml_text
from ballbot_ros.robot.world.floor_map import map_path, read_map_file
from ballbot_ros.run.spec import RunSpec

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
        The study, as it is in the folder.
    study : Study
        The same; its specification has no class of a controller, which can't be pickled.
    """

    record: StudyRecord
    study: Study
    folder: Path

    @property
    def spec(self) -> RunSpec:
        """The run that all are like, but for their samples."""
        return self.study.spec

    def do(self, part: int, samples: Samples, advance: Advance = ignore) -> PartSummary:
        """Simulate, judge and write a part.

        It raises BallbotError if a value is not possible, or the part can't be written; the message
        is one line.
        """
        return self.store(part, self.encode(part, samples, advance))

    def store(self, part: int, encoded: EncodedPart) -> PartSummary:
        """Write a part; StudyError if it can't be written."""
        store_part(self.folder, self.record, part, encoded.data)
        return encoded.summary

    def simulate(self, samples: Samples, advance: Advance = ignore) -> Results:
        """Return the results of runs; BallbotError if a value is not possible."""
        return _simulator(self).simulate(samples, advance)

    def encode(self, part: int, samples: Samples, advance: Advance = ignore) -> EncodedPart:
        """Simulate and judge a part, and return the bytes of its file.

        It raises BallbotError if a value is not possible; the message is one line.
        """
        results = self.simulate(samples, advance)
        if self.study.redesign:
            has_gains = np.any([samples.values[name] for name in GAINS], axis=0)
            results.failed[~has_gains] = True
        varied = {**samples.values, **samples.events}
        seeds = varied.get(SEED, np.full(samples.count, self.spec.plant.seed))
        # What has no time to be judged has no value, though it holds.
        measured = np.where(np.isinf(results.measured), np.nan, results.measured)
        good = passed(results, self.study.measures, self.study.expectations)
        outcomes = np.where(results.failed, Outcome.FAILED.value, Outcome.COMPLETED.value)
        columns = [
            np.array(self.record.numbers(part)), seeds.astype(np.int64),
            *(varied[each.name] for each in self.record.varied), *measured.T,
            good, outcomes, results.fallen, results.ticks, results.duty_sha256,
        ]  # fmt: skip
        return encode_part(self.record, part, columns)


def job_of(study: Study, folder: Path, runs_per_part: int | None = None) -> Job:
    """Return the job of a study whose results are in a folder.

    By default a part is a few seconds of work. It raises BallbotError if the map can't be read.
    """
    spec = replace(study.spec, controller=None)
    gains = [ResultColumn(name, meaning='designed for the robot') for name in GAINS]
    varied = [
        ResultColumn(
            each.name,
            ColumnKind.of(each.distribution.values(np.zeros(1))),
            each.parameter.unit,
            each.parameter.description,
        )
        for each in study.variables
    ]
    record = StudyRecord(
        study.name,
        text=study.text,
        scenario=yaml_text(scenario_data(*study.common_scenario)),
        parameters=parameter_text(spec.parameters) + _identities(study.spec),
        runs=study.runs,
        seed=study.seed,
        runs_per_part=runs_per_part or _runs_per_part(study),
        varied=(*varied, *(gains if study.redesign else ())),
        measures=study.measure_columns,
    )
    return Job(record, replace(study, spec=spec), folder)


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
    is_slow = study.redesign or why_not_compiled(study.spec)
    work_s = ORDINARY_PART_S if is_slow else COMPILED_PART_S
    _, longest = study.common_scenario
    runs = min(work_s / longest.duration, study.runs / FEWEST_PARTS)
    return max(1, round(runs), -(-study.runs // MOST_PARTS))


def passed(
    results: Results, measures: Sequence[Measure | Property], expectations: Sequence[Expectation]
) -> NDArray[np.bool_]:
    """Return for each run whether it was completed and all expectations and properties hold."""
    good = ~results.failed
    for each in expectations:
        good &= each.holds(results.measured[:, measures.index(each.measure)])
    for number, of in enumerate(measures):
        if isinstance(of, Property):
            good &= results.measured[:, number] >= 0.0
    return good


_simulators: dict[str, Simulator] = {}
_making = Lock()


def _simulator(job: Job) -> Simulator:
    """Return the simulator of a study; the last one made is kept, for all threads."""
    identity = job.record.identity
    with _making:
        if identity not in _simulators:
            _simulators.clear()
            _simulators[identity] = simulator_for(job.spec, job.study.measures)
        return _simulators[identity]


class PackedFile(NamedTuple):
    """A file: its name without folders, and its content."""

    name: str
    data: bytes

    def unpack(self, folder: Path) -> Path:
        """Write the file below a folder, unless it is there; StudyError if it can't be written."""
        path = folder / hashlib.sha256(self.data).hexdigest() / self.name
        if path.exists():
            return path
        with os_errors(StudyError, path):
            path.parent.mkdir(parents=True, exist_ok=True)
            # Other threads may do the same, and read the file as soon as it has its name.
            write_atomically(path, self.data)
        return path


@dataclass(frozen=True)
class PackedJob:
    """A job that any machine can do.

    Attributes
    ----------
    job : Job
        Its folder and the paths of its files are meaningless elsewhere.
    map : PackedFile or None
        The map. Shipped ones are packed, too: the hash of the package's code leaves them out.
    controller : PackedFile or None
        The file of a controller.
    controller_sha256 : str
        Hash of the controller's code; '' for the document's program.
    """

    job: Job
    map: PackedFile | None
    controller: PackedFile | None
    controller_sha256: str

    @classmethod
    def of(cls, job: Job) -> PackedJob:
        """Read the files of a job; BallbotError if one can't be read."""
        packed_map = controller = None
        sha256 = ''
        if name := job.spec.plant.map:
            packed_map = PackedFile(map_path(name).name, read_map_file(name))
        reference = _controller_of(job)
        if reference not in DOCUMENTS_PROGRAM:
            code = find_code(reference)
            sha256 = code.source.sha256
            if is_file_reference(reference):
                controller = PackedFile(code.path.name, code.source.data)
        return cls(replace(job, folder=Path()), packed_map, controller, sha256)

    def unpack(self, folder: Path) -> Job:
        """Write the files below a folder, and return the job with their paths.

        It raises BallbotError if a file can't be written, or an installed controller has other code
        here.
        """
        parameters = ParameterSet(self.job.spec.parameters)
        if self.map:
            parameters.set(PLANT, 'map', str(self.map.unpack(folder)))
        reference = _controller_of(self.job)
        if self.controller:
            class_name = reference.rpartition(':')[2]
            reference = f'{self.controller.unpack(folder)}:{class_name}'
            parameters.set(CONTROLLER, 'implementation', reference)
        if self.controller_sha256 and find_code(reference).source.sha256 != self.controller_sha256:
            raise StudyError(f'its controller {reference} has other code')
        spec = replace(self.job.spec, parameters=parameters)
        return replace(self.job, study=replace(self.job.study, spec=spec))


def _controller_of(job: Job) -> str:
    return job.spec.parameters.of(ControllerParameters).implementation
