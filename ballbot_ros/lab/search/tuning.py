"""Tunings: what is tuned, on which robots, and for what; read from a file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, cast

import numpy as np

from ballbot_ros.engine.scenario.metrics import METRICS
from ballbot_ros.engine.scenario.reader import Keys
from ballbot_ros.errors import BallbotError, StudyError
from ballbot_ros.files import shipped_names
from ballbot_ros.lab.search.candidates import has_value, share_of
from ballbot_ros.lab.search.objective import DEAD_TIME_MARGIN, MEAN, WORST, Limit, Objective
from ballbot_ros.lab.search.optimiser import Method
from ballbot_ros.lab.studies.reader import STUDY_KEYS, StudyReader
from ballbot_ros.lab.studies.study import MAX_RUNS, Sampling, Study
from ballbot_ros.lab.studies.variables import GRID, Levels, Variable, identity, nominal_value
from ballbot_ros.parameters import CONTROLLER, DOCUMENTS_PROGRAM, ControllerParameters, suggest
from ballbot_ros.parameters.yaml_document import YamlDocument
from ballbot_ros.robot.arithmetic import Floats
from ballbot_ros.run.spec import RunSpec

MAX_CANDIDATES, MAX_POPULATION = 1_000_000, 1_000
MAX_GENERATION = 10_000_000
"""Largest number of runs of a generation, whose values are in memory."""
MAX_WEIGHT = 1e9
_START = 'start'


@dataclass(frozen=True)
class Tuning:
    """A tuning, as read from its file.

    Attributes
    ----------
    studies : tuple of Study
        The robots on which each candidate is tried: a study for each scenario.
    start : ndarray, shape (d,)
        Where the search begins, as shares of the ranges.
    candidates, population : int
        Number of candidates, and of those of a generation.
    unseen : int
        Number of robots on which the result is judged.
    """

    name: str
    studies: tuple[Study, ...]
    tuned: tuple[Variable, ...]
    start: Floats
    objective: Objective
    candidates: int
    population: int
    unseen: int
    method: Method = Method.CMA

    @property
    def controller(self) -> str:
        """Name of the controller's class, or of the document's program."""
        reference = self.studies[0].spec.parameters.of(ControllerParameters).implementation
        return reference.rpartition(':')[2]

    @property
    def generations(self) -> int:
        """Number of generations."""
        return -(-self.candidates // self.population)


class TuningReader(StudyReader):
    """Reads the file of a tuning: that of a study, and what is tuned for what."""

    what: ClassVar[str] = 'the tuning'
    keys: ClassVar[frozenset[str]] = STUDY_KEYS - {'controller', 'redesign'} | {
        'tune', 'objective', 'limits', 'candidates', 'population', 'unseen',
    }  # fmt: skip

    def tuning(self, candidates: int | None = None, method: Method = Method.CMA) -> Tuning:
        """Return the tuning in the document; `candidates` replaces the file's number of them.

        It raises BallbotError; the message is one line that names file and line.
        """
        if candidates is not None and candidates > MAX_CANDIDATES:
            raise StudyError(f'--candidates {candidates}: not within 1 … {MAX_CANDIDATES}')
        data = self._content()
        studies = tuple(self.studies())
        names = [each.spec.scenario.name for each in studies]
        if len(set(names)) < len(names):
            raise self._error(('scenario',), f'two scenarios have the same name: {min(names)}')
        if studies[0].sampling is Sampling.GRID:
            raise self._error(('sampling',), 'a grid has no robots that were not seen; use sobol')
        tuned, starts = self._tuned(data, studies)
        objective = self._objective(data, studies)
        default = 4 + int(3 * np.log(len(tuned)))  # that of CMA-ES
        population = self._whole(
            data.get('population', -(-default // 4) * 4), ('population',), 2, MAX_POPULATION
        )
        given = self._whole(data.get('candidates', 1000), ('candidates',), 1, MAX_CANDIDATES)
        runs = population * studies[0].runs
        if runs > MAX_GENERATION or -(-(candidates or given) // population) * runs > MAX_RUNS:
            raise self._error(
                ('runs',),
                f'{runs:,} runs of a generation, population times runs, are more than '
                f'{MAX_GENERATION:,}, or those of all candidates more than {MAX_RUNS:,}',
            )
        unseen = self._whole(data.get('unseen', 1000), ('unseen',), 1, MAX_CANDIDATES)
        return Tuning(
            self._document.path.stem, studies, tuned, starts, objective, candidates or given,
            population, unseen, method,
        )  # fmt: skip

    def _error(self, keys: Keys, text: str) -> BallbotError:
        # Where the controller, and metrics that are not listed, stand in this file.
        for key, place in (('controller', 'tune'), ('metrics', 'objective')):
            if keys[:1] == (key,) and key not in cast(Any, self._document.data):
                keys = (place,)
        return super()._error(keys, text)

    def _content(self) -> dict[str, object]:
        data = super()._content()
        for required in ('tune', 'objective'):
            if required not in data:
                raise self._error((), f'{required} is missing')
        data['controller'] = self._chosen(data)
        limited = self._mapping(data.get('limits', {}), ('limits',))
        needed = dict.fromkeys(each for each in (*self._terms(data), *limited) if each in METRICS)
        given = data.get('metrics', [])
        # Metrics that are wrong are left to the reader of studies.
        if isinstance(given, list) and (given or 'metrics' not in data) and (given or needed):
            data['metrics'] = [*given, *(each for each in needed if each not in given)]
        return data

    def _chosen(self, data: Mapping[str, object]) -> str:
        """Return the controller that is tuned: the first one, unless another is asked for."""
        known = list(self._mapping(data['tune'], ('tune',)))
        if not known:
            raise self._error(('tune',), 'nothing is tuned: needs a controller and its parameters')
        for key in known:
            if not isinstance(key, str):
                raise self._error(('tune', key), f'{key!r} is no name of a controller')
        chosen = self._controller or known[0]
        if chosen not in known:
            raise StudyError(
                f'--controller {chosen}: {self._document.path} tunes {", ".join(known)}'
            )
        return chosen

    def _tuned(
        self, data: Mapping[str, object], studies: tuple[Study, ...]
    ) -> tuple[tuple[Variable, ...], Floats]:
        """Return what is tuned, and where the search begins."""
        controller = cast(str, data['controller'])
        at: Keys = ('tune', controller)
        spec, found, starts = studies[0].spec, dict[Any, Variable](), list[float]()
        varied = {identity(each.name, each.parameter) for each in studies[0].variables}
        for key, content in self._mapping(
            self._mapping(data['tune'], ('tune',))[controller], at
        ).items():
            keys = (*at, key)
            given = dict(self._mapping(content, keys))
            start = {_START: given.pop(_START)} if _START in given else {}
            if GRID in given:
                raise self._error((*keys, GRID), f'{key}: {GRID} is only for studies')
            variable = self._variable(str(key), given, keys, spec)
            if not variable.name.startswith(f'{CONTROLLER}.'):
                raise self._error(keys, f'{key}: only parameters of {CONTROLLER} can be tuned')
            same = identity(variable.name, variable.parameter)
            if same in varied or same in found:
                raise self._error(keys, f'{key} varies already')
            found[same] = variable
            starts.append(self._start(start, keys, variable, spec))
        if not found:
            raise self._error(at, f'nothing of {controller} is tuned')
        return tuple(found.values()), np.array(starts)

    def _start(
        self, given: Mapping[str, object], keys: Keys, variable: Variable, spec: RunSpec
    ) -> float:
        """Return the share of the range at which a search begins: by default the value in force."""
        distribution, parameter = variable.distribution, variable.parameter
        value: Any = nominal_value(spec, variable)
        if given:
            value = parameter.check(given[_START], f'{self._document.where(*keys, _START)}: ')
        if not has_value(distribution, value):
            start = 'start' if given else 'start, by default the value in force,'
            if isinstance(distribution, Levels):
                allowed = f'one of {", ".join(map(str, distribution.levels))}'
            else:
                allowed = 'within {:g} … {:g}'.format(*distribution.ends)
            shown = f'{value:g}' if isinstance(value, float) else value
            raise self._error(keys, f'{variable.name}: the {start} {shown} is not {allowed}')
        return share_of(distribution, value)

    def _terms(self, data: Mapping[str, object]) -> Mapping[str, object]:
        content = self._mapping(data['objective'], ('objective',), ('over', 'sum'))
        if 'sum' not in content:
            raise self._error(('objective',), 'objective: needs sum, measures with their weights')
        return self._mapping(content['sum'], ('objective', 'sum'))

    def _objective(self, data: Mapping[str, object], studies: Sequence[Study]) -> Objective:
        known, *others = ([each.name for each in study.measure_columns] for study in studies)
        known = [name for name in known if all(name in each for each in others)]
        weights: dict[str, float] = {}
        for name, weight in self._terms(data).items():
            keys = ('objective', 'sum', name)
            self._check_measure(str(name), keys, known)
            weights[str(name)] = self._number(weight, keys)
            if not 0.0 < weights[str(name)] <= MAX_WEIGHT:
                raise self._error(
                    keys, f'{name}: the weight is not above 0, and {MAX_WEIGHT:g} at most'
                )
        if not weights:
            raise self._error(('objective', 'sum'), 'sum: has no measures')
        limits = tuple(
            self._limit(str(name), bounds, known)
            for name, bounds in self._mapping(data.get('limits', {}), ('limits',)).items()
        )
        implementation = studies[0].spec.parameters.of(ControllerParameters).implementation
        if implementation not in DOCUMENTS_PROGRAM:  # whose loop is not analysed
            limits = tuple(each for each in limits if each.name != DEAD_TIME_MARGIN)
        content = self._mapping(data['objective'], ('objective',))
        return Objective(weights, self._over(content.get('over', MEAN)), limits)

    def _over(self, given: object) -> float | None:
        keys = ('objective', 'over')
        if given in (MEAN, WORST):
            return None if given == MEAN else 1.0
        share = given if isinstance(given, float) else None
        if share is None or not 0.0 < share < 1.0:
            raise self._error(
                keys, f'over: {given!r} is neither {MEAN}, {WORST} nor a quantile such as 0.95'
            )
        return share

    def _limit(self, name: str, data: object, known: list[str]) -> Limit:
        keys = ('limits', name)
        if name != DEAD_TIME_MARGIN:
            self._check_measure(name, keys, known)
        bounds = self._mapping(data, keys, ('min', 'max'))
        if len(bounds) != 1:
            raise self._error(keys, f'{name}: needs either min or max')
        values = {key: self._number(value, (*keys, key)) for key, value in bounds.items()}
        return Limit(name, values.get('min'), values.get('max'))

    def _check_measure(self, name: str, keys: Keys, known: list[str]) -> None:
        if name not in known:
            names = dict.fromkeys((*known, *METRICS))
            raise self._error(keys, f'unknown measure {name!r}; {suggest(name, names)}')


def tuning_names() -> list[str]:
    """Return the names of the shipped tunings."""
    return shipped_names('tunings')


def read_tuning(
    reference: str,
    candidates: int | None = None,
    seed: int | None = None,
    controller: str | None = None,
    parameter_file: Path | None = None,
    method: Method = Method.CMA,
) -> Tuning:
    """Read a shipped tuning by its name, or a file by its path.

    Parameters
    ----------
    candidates, seed : int or None
        Numbers in place of the file's.
    controller : str or None
        One of the controllers that the file tunes; by default the first.
    parameter_file : Path or None
        File of parameters whose values take the place of the file's, such as another start.

    Raises
    ------
    BallbotError
        The message is one line that names file, line, key, and what is allowed.
    """
    document = YamlDocument.named(reference, 'tunings', 'tuning', StudyError)
    reader = TuningReader(document, None, seed, controller, parameter_file)
    return reader.tuning(candidates, method)
