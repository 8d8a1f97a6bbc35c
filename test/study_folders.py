"""Studies with made-up results."""

from dataclasses import dataclass, replace
from datetime import datetime, timezone
from typing import Any

import numpy as np

from ballbot_ros.engine.scenario.scenario import Expectation, Measure
from ballbot_ros.lab.studies.columns import ColumnKind, MeasureColumn, ResultColumn
from ballbot_ros.lab.studies.data_set import begin_or_resume
from ballbot_ros.lab.studies.manifest import PartSummary, StudyRecord, Versions
from ballbot_ros.lab.studies.part_file import encode_part, store_part
from ballbot_ros.lab.studies.runs import Results
from ballbot_ros.lockstep.run_actions import Outcome

NOW = datetime(2026, 1, 2, 3, 4, 5, tzinfo=timezone.utc)

VARIED = (
    ResultColumn('plant_sim.body_mass', unit='kg', meaning='mass of the body'),
    ResultColumn('controller.dead_ticks', ColumnKind.INTEGER),
    ResultColumn('plant_sim.model', ColumnKind.TEXT),
)
EXPECTATIONS = (
    Expectation('peak_pitch_deg', maximum=5.0),
    Expectation('final_position_x_m', minimum=0.1, maximum=0.3, end=7.5),
)
MEASURES = tuple(
    MeasureColumn.of(each, EXPECTATIONS)
    for each in (
        Measure('peak_pitch_deg'),
        Measure('settling_time_s'),
        Measure('final_position_x_m', end=7.5),
        Measure('wall_clearance_m'),
    )
)


@dataclass(frozen=True)
class PartRows:
    """The runs of a part."""

    seed: Any
    varied: Any
    results: Results
    passed: Any

    @property
    def summary(self):
        failed, fallen = self.results.failed, self.results.fallen
        return PartSummary(
            len(self.seed), *(int(each.sum()) for each in (self.passed, failed, fallen))
        )


def encoded(study, part, rows):
    """Return a part with these rows, and its numbers of runs."""
    results = rows.results
    outcomes = np.where(results.failed, Outcome.FAILED.value, Outcome.COMPLETED.value)
    columns = [
        np.array(study.numbers(part)), rows.seed, *rows.varied, *results.measured.T, rows.passed,
        outcomes, results.fallen, results.ticks, results.duty_sha256,
    ]  # fmt: skip
    return encode_part(study, part, columns)


def record(**changes):
    """Return a study of 3 parts, of which the last has fewer runs."""
    study = StudyRecord(
        'robustness',
        text='runs: 25\n',
        scenario='purpose: stand – straight\n',
        parameters='plant_sim: {}\n',
        runs=25,
        seed=1,
        runs_per_part=10,
        varied=VARIED,
        measures=MEASURES,
        code_sha256='0' * 64,
        versions=Versions('0.1', '3.12', '2.0', '1.14', '0.60', '18.0'),
    )
    return replace(study, **changes)


def rows_of(study, part, seed=0):
    """Return random rows of a part; the same for the same arguments."""
    numbers = study.numbers(part)
    runs = len(numbers)
    random = np.random.default_rng([seed, part])
    failed = random.random(runs) < 0.2
    measured = random.normal(0.0, 3.0, (runs, len(study.measures)))
    measured[failed, 1] = np.nan
    measured[:, 3] = np.nan  # no walls
    results = Results(
        random.integers(0, 256, (runs, 32), np.uint8),
        np.where(failed, 100, 2500),
        failed,
        failed | (random.random(runs) < 0.1),
        measured,
    )
    varied = [
        random.uniform(0.8, 1.2, runs),
        random.integers(0, 5, runs),
        random.choice(np.array(['linear', 'nonlinear']), runs),
    ]
    return PartRows(
        random.integers(0, 2**63, runs), varied, results, ~failed & (measured[:, 0] < 5)
    )


def write_part(folder, study, part, rows):
    """Write a part as a worker does; return its numbers of runs."""
    data, summary = encoded(study, part, rows)
    store_part(folder, study, part, data)
    return summary


def write_study(folder, study=None, parts=None):
    """Write a study, finished if all parts are written."""
    study = study or record()
    with begin_or_resume(folder, study, NOW) as begun:
        for part in range(study.parts) if parts is None else parts:
            write_part(folder, study, part, rows_of(study, part))
        begun.finish(NOW)
    return study
