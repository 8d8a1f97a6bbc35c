"""Results of a study, read from its folder."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from statistics import NormalDist
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ballbot_ros.engine.rows import Column
from ballbot_ros.errors import StudyError, importing, os_errors
from ballbot_ros.lab.studies.columns import (
    DUTY_SHA256,
    FALLEN,
    NUMBER,
    OUTCOME,
    PASSED,
    SEED,
    TICKS,
    MeasureColumn,
)
from ballbot_ros.lab.studies.data_set import read_manifest
from ballbot_ros.lab.studies.manifest import Manifest, PartSummary, StudyRecord
from ballbot_ros.lab.studies.part_file import (
    PARTS,
    DamagedPartError,
    check_part,
    load_pyarrow,
    read_columns,
    read_part,
)
from ballbot_ros.lockstep.run_actions import Outcome
from ballbot_ros.robot.arithmetic import Floats

if TYPE_CHECKING:
    import pandas


class ProportionInterval(NamedTuple):
    """A confidence interval of a proportion."""

    low: float
    high: float


def wilson_interval(successes: int, count: int) -> ProportionInterval:
    """Return Wilson's 95 % score interval of a proportion, without continuity correction.

    Unlike the interval that is symmetric about the share, it stays within 0 and 1, and has a width
    even if all or none succeed. Without any trial it is the whole range.

    Parameters
    ----------
    successes, count : int
        Number of successes, and of all trials.

    Raises
    ------
    ValueError
        If there are more successes than trials, or fewer than 0.

    References
    ----------
    E. B. Wilson: Probable inference, the law of succession, and statistical inference. Journal of
    the American Statistical Association 22 (1927), 209–212.
    """
    if not 0 <= successes <= count:
        raise ValueError(f'{successes} successes of {count}')
    if count == 0:
        return ProportionInterval(0.0, 1.0)
    z = NormalDist().inv_cdf(0.975)
    squared = z * z
    middle = (successes + squared / 2) / (count + squared)
    variance = successes * (count - successes) / count + squared / 4
    half_width = z * math.sqrt(variance) / (count + squared)
    # Where all or none succeed, the ends are exact, whatever the rounding.
    low = 0.0 if successes == 0 else middle - half_width
    high = 1.0 if successes == count else middle + half_width
    return ProportionInterval(low, high)


QUANTILES = (0.05, 0.25, 0.5, 0.75, 0.95)
WORST_RUNS = 3
"""Number of the worst runs of a measure that a summary has."""

_REMEDY = 'give the command of the study again, which redoes this part'


@dataclass(frozen=True)
class RunResults:
    """Results of a run.

    Attributes
    ----------
    varied : mapping of str to value
        The varied values by variable.
    measures : mapping of str to float
        The measures by column; NaN if there is no value.
    duty_sha256 : str
        Hexadecimal.
    """

    number: int
    seed: int
    varied: Mapping[str, bool | int | float | str]
    measures: Mapping[str, float]
    passed: bool
    outcome: Outcome
    fallen: bool
    ticks: int
    duty_sha256: str


class RankedRun(NamedTuple):
    """A run, and its value of a measure."""

    number: int
    value: float


@dataclass(frozen=True)
class MeasureSummary:
    """Distribution of a measure.

    Attributes
    ----------
    count, missing : int
        Numbers of runs with and without a value.
    quantiles : ndarray, shape (5,)
        The `QUANTILES` of the values, interpolated linearly; NaN if there are none.
    worst : list of RankedRun
        The worst values, worst first.
    """

    column: MeasureColumn
    count: int
    missing: int
    quantiles: Floats
    worst: list[RankedRun]


@dataclass(frozen=True)
class StudySummary:
    """Summary of a study, with Wilson's 95 % interval of the share that passed."""

    totals: PartSummary
    interval: ProportionInterval
    measures: list[MeasureSummary]

    @property
    def share_passed(self) -> float:
        """The share that passed; NaN without runs."""
        return self.totals.passed / self.totals.runs if self.totals.runs else float('nan')


@dataclass(frozen=True)
class StudyData:
    """Results of a study, finished or not.

    No rows are kept in memory. Methods that cover the study read a part, or a column of a part, at
    a time. Each part is checked once, completely, before a column of it is read: the checksums of a
    column do not cover the description of the file.

    Attributes
    ----------
    path : Path
        The folder.
    present : tuple of int
        The parts that are there; those of a finished study are all.
    """

    path: Path
    manifest: Manifest
    present: tuple[int, ...]
    _summaries: dict[int, PartSummary] = field(default_factory=dict, repr=False, compare=False)

    @classmethod
    def open(cls, path: Path) -> StudyData:
        """Open the folder of a study.

        It raises StudyError if it is no such folder, a part of a finished study is missing, or
        pyarrow is not installed.
        """
        load_pyarrow()
        manifest = read_manifest(path)
        study = manifest.study
        with os_errors(StudyError, path / PARTS):
            names = {each.name for each in (path / PARTS).iterdir()}
        present = tuple(part for part in range(study.parts) if study.part_name(part) in names)
        if manifest.finished and len(present) < study.parts:
            missing = next(part for part in range(study.parts) if part not in present)
            raise StudyError(f'{path / PARTS / study.part_name(missing)}: missing; {_REMEDY}')
        return cls(path, manifest, present)

    @property
    def study(self) -> StudyRecord:
        """The study."""
        return self.manifest.study

    @property
    def missing(self) -> tuple[int, ...]:
        """The parts that are not there."""
        return tuple(sorted(set(range(self.study.parts)).difference(self.present)))

    def totals(self) -> PartSummary:
        """Return the numbers of runs.

        It raises StudyError if a part is damaged; so do the other methods.
        """
        with _with_remedy():
            return sum(map(self._checked, self.present), PartSummary())

    def parts(self, names: Sequence[str]) -> Iterator[dict[str, Column]]:
        """Yield some columns of the parts by their names, in the order of the runs."""
        for part in self.present:
            with _with_remedy():
                self._checked(part)
                columns = read_columns(self._file(part), self.study, part, names)
            yield columns

    def table(self) -> Any:
        """Return all rows as a table of pyarrow, in the order of the runs."""
        with _with_remedy():
            tables = [read_part(self._file(each), self.study, each) for each in self.present]
        if not tables:
            raise StudyError(f'{self.path}: has no results yet')
        without = [each.replace_schema_metadata(None) for each in tables]
        return load_pyarrow().concat_tables(without).unify_dictionaries()

    def frame(self) -> pandas.DataFrame:
        """Return all rows as a data frame, with hashes as hexadecimal text.

        It raises BallbotError if pandas is not installed, or a part is damaged.
        """
        with importing('pandas'):
            import pandas  # noqa: F401
        frame: pandas.DataFrame = self.table().to_pandas()
        frame[DUTY_SHA256.name] = [each.hex() for each in frame[DUTY_SHA256.name]]
        return frame

    def column(self, name: str) -> Column:
        """Return the values of a column of numbers or truth values, NaN where there is none.

        It takes the memory of one number a run.
        """
        # Filled in place, which takes half the memory of a list of parts that is joined.
        values: Column | None = None
        done = 0
        for columns in self.parts([name]):
            part = columns[name]
            if values is None:
                values = np.empty(sum(map(len, map(self.study.numbers, self.present))), part.dtype)
            values[done : done + len(part)] = part
            done += len(part)
        return np.empty(0) if values is None else values

    def row(self, number: int) -> RunResults:
        """Return the results of a run; only its part is read."""
        study = self.study
        if not 0 <= number < study.runs:
            raise StudyError(
                f'{self.path}: has no run {number}; the runs are 0 to {study.runs - 1}'
            )
        part = number // study.runs_per_part
        if part not in self.present:
            raise StudyError(
                f'{self.path}: run {number} has not been done yet: '
                'give the command of the study again'
            )
        with _with_remedy():
            table = read_part(self._file(part), study, part)
        place = number - study.numbers(part).start
        row = table.slice(place, 1).to_pydict()
        values: dict[str, Any] = {
            name: math.nan if value is None else value for name, (value,) in row.items()
        }
        return RunResults(
            values[NUMBER.name],
            values[SEED.name],
            {each.name: values[each.name] for each in study.varied},
            {each.name: values[each.name] for each in study.measures},
            values[PASSED.name],
            Outcome(values[OUTCOME.name]),
            values[FALLEN.name],
            values[TICKS.name],
            values[DUTY_SHA256.name].hex(),
        )

    def failed(self) -> Iterator[int]:
        """Yield the numbers of the runs that failed, in order."""
        for columns in self.parts([NUMBER.name, OUTCOME.name]):
            yield from columns[NUMBER.name][columns[OUTCOME.name] == Outcome.FAILED].tolist()

    def not_passed(self) -> Iterator[int]:
        """Yield the numbers of the runs that did not pass, in order; the failed are among them."""
        for columns in self.parts([NUMBER.name, PASSED.name]):
            yield from columns[NUMBER.name][~columns[PASSED.name]].tolist()

    def worst(self, measure: str, count: int = WORST_RUNS) -> list[RankedRun]:
        """Return the runs with the worst values of a measure, worst first.

        `MeasureColumn.badness` says which are the worst. Runs without a value are not among
        them. Of equal values the first runs are taken. It takes the memory of one number a run.
        """
        column = self.measure(measure)
        return self._worst(column, self.column(column.name), count)

    def _worst(self, column: MeasureColumn, values: Floats, count: int) -> list[RankedRun]:
        # NaN sorts last.
        places = np.argsort(-column.badness(values), kind='stable')[: max(count, 0)]
        places = places[~np.isnan(values[places])]
        numbers = self._present_numbers()[places]
        return list(map(RankedRun, numbers.tolist(), values[places].tolist()))

    def measure(self, name: str) -> MeasureColumn:
        """Return the column of a measure.

        It raises StudyError if there is none of this name.
        """
        for each in self.study.measures:
            if each.name == name:
                return each
        known = ', '.join(each.name for each in self.study.measures) or 'none'
        raise StudyError(f'{self.path}: has no measure {name!r}; measures: {known}')

    def summary(self) -> StudySummary:
        """Return a summary; it takes the memory of one number a run."""
        totals = self.totals()
        measures = list(map(self._summary, self.study.measures))
        return StudySummary(totals, wilson_interval(totals.passed, totals.runs), measures)

    def _summary(self, column: MeasureColumn) -> MeasureSummary:
        values = self.column(column.name)
        worst = self._worst(column, values, WORST_RUNS)
        runs = len(values)
        kept = values[~np.isnan(values)]
        del values
        quantiles = np.full(len(QUANTILES), np.nan)
        if kept.size:
            quantiles = np.quantile(kept, QUANTILES, overwrite_input=True)
        return MeasureSummary(column, kept.size, runs - kept.size, quantiles, worst)

    def _present_numbers(self) -> NDArray[np.int64]:
        """Return the numbers of the runs that have been done."""
        ranges = map(self.study.numbers, self.present)
        numbers = [np.arange(each.start, each.stop) for each in ranges]
        return np.concatenate([np.empty(0, np.int64), *numbers])

    def _checked(self, part: int) -> PartSummary:
        """Return the numbers of runs of a part that is undamaged."""
        if part not in self._summaries:
            self._summaries[part] = check_part(self._file(part), self.study, part)
        return self._summaries[part]

    def _file(self, part: int) -> Path:
        return self.path / PARTS / self.study.part_name(part)


@contextmanager
def _with_remedy() -> Iterator[None]:
    try:
        yield
    except DamagedPartError as error:
        raise StudyError(f'{error}; {_REMEDY}') from None
