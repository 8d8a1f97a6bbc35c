"""The manifest of a study's folder: what the results are results of."""

from __future__ import annotations

import hashlib
import json
import platform
from collections.abc import Mapping
from dataclasses import asdict, astuple, dataclass, field
from functools import cached_property
from operator import add

import ballbot_ros
from ballbot_ros.engine.compilation import code_sha256
from ballbot_ros.errors import StudyError
from ballbot_ros.lab.studies.columns import AFTER, BEFORE, ColumnKind, MeasureColumn, ResultColumn
from ballbot_ros.run.graph import version_of

FORMAT = 1
"""Version of the folder's format; a reader takes no other."""


@dataclass(frozen=True)
class Versions:
    """Versions of the software; empty if it is not installed."""

    ballbot_ros: str
    python: str
    numpy: str
    scipy: str
    numba: str
    pyarrow: str

    @classmethod
    def current(cls) -> Versions:
        """Return the versions in use."""
        packages = ('numpy', 'scipy', 'numba', 'pyarrow')
        return cls(ballbot_ros.__version__, platform.python_version(), *map(version_of, packages))


_DRAWING = ('numpy', 'scipy')
"""Packages whose other versions may draw other samples. The others do not change a result."""


@dataclass(frozen=True)
class PartSummary:
    """Numbers of runs of a part, or of several."""

    runs: int = 0
    passed: int = 0
    failed: int = 0
    fallen: int = 0

    def __add__(self, other: PartSummary) -> PartSummary:
        return PartSummary(*map(add, astuple(self), astuple(other)))


@dataclass(frozen=True)
class StudyRecord:
    """All that determines the results of a study, and how they are laid out.

    Two studies are the same if their `identity` is. Of the versions only those of numpy and scipy
    count for it, which draw the samples; `code_sha256` stands for this package, and results do not
    depend on the others.

    Attributes
    ----------
    text, scenario, parameters : str
        Texts of the study, of its scenario and of its parameters.
    runs, seed, runs_per_part : int
        Number of runs, seed of the samples, and number of runs of all parts but the last.
    varied : tuple of Column
        What varies; the names are those of the variables.
    code_sha256 : str
        Hash of this package's code; by default of that in use.
    """

    name: str
    text: str
    scenario: str
    parameters: str
    runs: int
    seed: int
    runs_per_part: int
    varied: tuple[ResultColumn, ...]
    measures: tuple[MeasureColumn, ...]
    code_sha256: str = field(default_factory=code_sha256)
    versions: Versions = field(default_factory=Versions.current)

    def __post_init__(self) -> None:
        if self.runs < 1 or self.runs_per_part < 1:
            raise StudyError(f'{self.name}: needs at least one run, and one run a part')
        names = [each.name for each in self.columns]
        if doubled := sorted({each for each in names if names.count(each) > 1}):
            raise StudyError(f'{self.name}: two columns have the name {doubled[0]}')

    @property
    def columns(self) -> tuple[ResultColumn, ...]:
        """All columns, in the order of the Parquet files."""
        return (*BEFORE, *self.varied, *self.measures, *AFTER)

    @property
    def parts(self) -> int:
        """Number of parts."""
        return -(-self.runs // self.runs_per_part)

    def numbers(self, part: int) -> range:
        """Return the numbers of the runs of a part."""
        first = part * self.runs_per_part
        return range(first, min(first + self.runs_per_part, self.runs))

    def part_name(self, part: int) -> str:
        """Return the name of a part's file; names sort in the order of the parts."""
        digits = max(6, len(str(self.parts - 1)))
        return f'part-{part:0{digits}d}.parquet'

    @cached_property
    def identity(self) -> str:
        """SHA-256 of all that distinguishes the study from others."""
        return _digest(self._distinguishing())

    def difference(self, other: StudyRecord) -> str:
        """Return what differs first, as text that follows "another study:"; empty if nothing."""
        own, others = self._distinguishing(), other._distinguishing()
        for key, value in own.items():
            if value == others[key]:
                continue
            if key in ('name', 'runs', 'seed', *(f'{each} version' for each in _DRAWING)):
                return f'its {key}: {value}, not {others[key]}'
            return f'its {key} differs' if key in _SINGULAR else f'its {key} differ'
        return ''

    def _distinguishing(self) -> dict[str, object]:
        return {
            'name': self.name,
            'text': self.text,
            'scenario': self.scenario,
            'parameters': self.parameters,
            'runs': self.runs,
            'seed': self.seed,
            'runs per part': self.runs_per_part,
            'columns': [list(map(asdict, each)) for each in (self.varied, self.measures)],
            'code': self.code_sha256,
            **{f'{each} version': getattr(self.versions, each) for each in _DRAWING},
            'format': FORMAT,
        }


_SINGULAR = ('text', 'scenario', 'code', 'format')


@dataclass(frozen=True)
class Manifest:
    """A study, and how far it is.

    Attributes
    ----------
    begun : str
        Date and time, ISO 8601.
    finished : str
        Date and time; empty if runs are missing.
    totals : PartSummary
        Numbers of runs of a finished study.
    """

    study: StudyRecord
    begun: str
    finished: str = ''
    totals: PartSummary = PartSummary()

    def to_json(self) -> str:
        """Return the text of the file."""
        values = {'format': FORMAT, 'identity': self.study.identity, **asdict(self)}
        signed = {**values, 'sha256': _digest(values)}
        return json.dumps(signed, indent=2, ensure_ascii=False) + '\n'

    @classmethod
    def from_json(cls, text: str | bytes) -> Manifest:
        """Read the text of the file.

        It raises StudyError if it is no manifest, or of another format; the text lacks the file's
        name.
        """
        try:
            values = json.loads(text)
            if not isinstance(values, dict) or 'identity' not in values:
                raise StudyError('not the manifest of a study')
            if values['format'] != FORMAT:
                raise StudyError(
                    f'has format {values["format"]}, this version of ballbot_ros reads {FORMAT}'
                )
            # Nothing in a file that it confirms needs to be checked.
            if values.pop('sha256') != _digest(values):
                raise StudyError('damaged or altered')
            study = values['study']
            for key, kind in (('varied', ResultColumn), ('measures', MeasureColumn)):
                columns = [{**each, 'kind': ColumnKind(each['kind'])} for each in study[key]]
                study[key] = tuple(kind(**each) for each in columns)
            record = StudyRecord(**{**study, 'versions': Versions(**study['versions'])})
            totals = PartSummary(**values['totals'])
        except (ValueError, KeyError, TypeError, RecursionError):
            raise StudyError('damaged, or not the manifest of a study') from None
        return cls(record, values['begun'], values['finished'], totals)


def _digest(content: Mapping[str, object]) -> str:
    """Return the SHA-256 of what a file has."""
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()
