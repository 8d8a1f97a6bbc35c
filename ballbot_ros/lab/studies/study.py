"""Studies: what varies from run to run of a scenario, and what is measured."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np
import yaml

from ballbot_ros.controllers.design.redesign import Redesign
from ballbot_ros.engine.rows import Column
from ballbot_ros.engine.scenario.properties import Property
from ballbot_ros.engine.scenario.scenario import Expectation, Measure, Scenario
from ballbot_ros.errors import BallbotError, printable
from ballbot_ros.lab.studies.columns import MeasureColumn
from ballbot_ros.lab.studies.events import is_event
from ballbot_ros.lab.studies.programs import naming_run, with_values
from ballbot_ros.lab.studies.runs import Samples
from ballbot_ros.lab.studies.variables import (
    DISTRIBUTIONS,
    DURATION,
    GRID,
    LIST,
    LOG_UNIFORM,
    NORMAL,
    SEED,
    Grid,
    Levels,
    Variable,
)
from ballbot_ros.parameters import CONTROLLER, ControllerParameters, ParameterSet, PlantParameters
from ballbot_ros.parameters.parameter import TextEnum
from ballbot_ros.run.spec import RunSpec

CASE = ('scenario', 'controller')
"""What a study may have several of; each of their combinations is a study of its own."""

MAX_RUNS = 10**9
"""Largest number of runs of a study."""

K_F, K_I = f'{CONTROLLER}.k_f', f'{CONTROLLER}.k_i'

GAINS = (*(f'{K_F}.{number}' for number in range(1, 5)), K_I)
"""What is designed, by its names in samples and results."""


class Sampling(TextEnum):
    """How the values of the variables are chosen."""

    RANDOM = 'random'
    LATIN_HYPERCUBE = 'latin_hypercube'
    SOBOL = 'sobol'
    HALTON = 'halton'
    GRID = 'grid'


@dataclass(frozen=True)
class Study:
    """A study, as read from its file.

    Attributes
    ----------
    name, purpose : str
        Name of the file, and one line on the purpose.
    text : str
        Text of the file.
    runs : int
        Number of runs; for a grid a multiple of the number of its points.
    seed : int
        Seed of the samples.
    variables : tuple of Variable
        In the order of the file.
    draws_seeds : bool
        Whether each run has its own seed of the device noise, drawn with the samples.
    metrics : tuple of str
        Metrics of the whole run.
    spec : RunSpec
        The run that all are like, but for their samples.
    redesign : Redesign or None
        How the gains of each robot are designed; None if all have the same.
    case : mapping of str to str
        Its scenario and controller, if the file has several; its results are in such a folder.
    """

    name: str
    purpose: str
    text: str
    runs: int
    seed: int
    sampling: Sampling
    variables: tuple[Variable, ...]
    draws_seeds: bool
    metrics: tuple[str, ...]
    expectations: tuple[Expectation, ...]
    properties: tuple[Property, ...]
    spec: RunSpec
    redesign: Redesign | None = None
    case: Mapping[str, str] = field(default_factory=dict)

    def of_several(self) -> Study:
        """Return the study as one of several, with their words in its name."""
        controller = self.spec.parameters.of(ControllerParameters).implementation
        words = self.spec.scenario.name, controller.rpartition(':')[2]
        case = dict(zip(CASE, words, strict=True))
        return replace(self, name='_'.join((self.name, *words)), case=case)

    @property
    def measures(self) -> tuple[Measure | Property, ...]:
        """What is measured: the metrics of the whole run, windows of expectations, properties."""
        whole = [Measure(metric) for metric in self.metrics]
        windows = [each.measure for each in self.expectations]
        return (*dict.fromkeys([*whole, *windows]), *self.properties)

    @property
    def measure_columns(self) -> tuple[MeasureColumn, ...]:
        """The columns of what is measured, with the bounds that the study expects."""
        return tuple(MeasureColumn.of(each, self.expectations) for each in self.measures)

    @property
    def columns(self) -> tuple[str, ...]:
        """The names of what distinguishes the runs: the variables, and the seed if it is drawn."""
        names = tuple(each.name for each in self.variables)
        return (*names, SEED) if self.draws_seeds else names

    def samples(self, columns: Mapping[str, Column], first: int = 0) -> Samples:
        """Return the samples of consecutive runs, given the values of all of :attr:`columns`.

        They have the gains of each robot, if those are designed. Columns are (r,); `first` is the
        number of the first run, for error messages.
        """
        count = len(columns[self.columns[0]])
        values = {name: columns[name] for name in self.columns if not is_event(name)}
        events = {name: columns[name] for name in self.columns if is_event(name)}
        if self.redesign:
            parameters = self.spec.parameters
            values |= designed_gains(self.redesign, parameters, values, count, first)
        return Samples(count, values, events, first)

    @property
    def common_scenario(self) -> tuple[Scenario, PlantParameters]:
        """The scenario that all runs are like, and its plant, for a scenario file.

        Expectations and properties are the study's. It is as long as the longest run.
        """
        ends = {each.name: each.distribution.ends for each in self.variables}
        plant = self.spec.plant
        if DURATION in ends:
            plant = replace(plant, duration=float(ends[DURATION][1]))
        scenario = replace(self.spec.scenario, properties=self.properties)
        return replace(scenario, expectations=self.expectations), plant


def designed_gains(
    redesign: Redesign,
    parameters: ParameterSet,
    values: Mapping[str, Column],
    count: int,
    first: int,
) -> dict[str, Column]:
    """Return the :data:`GAINS` of consecutive runs; they are 0 for a robot that has no design.

    It raises StudyError if a value is not allowed.

    Parameters
    ----------
    parameters : ParameterSet
        Those of the run that all are like.
    values : mapping of str to ndarray
        The values of the parameters that vary, one for each run.
    count, first : int
        Number of runs, and the number of the first one.
    """
    columns = {name: column.tolist() for name, column in values.items() if name != SEED}
    known: dict[tuple[object, ...], tuple[float, ...]] = {}
    rows = []
    for run in range(count):
        of_run = {name: column[run] for name, column in columns.items()}
        key = tuple(of_run.values())
        if key not in known:
            with naming_run(first + run):
                known[key] = _gains(redesign, with_values(parameters, of_run))
        rows.append(known[key])
    return dict(zip(GAINS, np.array(rows).reshape(count, len(GAINS)).T, strict=True))


def _gains(redesign: Redesign, parameters: ParameterSet) -> tuple[float, ...]:
    try:
        redesign.apply(parameters)
    except BallbotError:
        return (0.0,) * len(GAINS)
    own = parameters.of(ControllerParameters)
    return (*own.k_f, own.k_i)


def grid_shape(variables: Iterable[Variable]) -> list[int]:
    """Return the numbers of levels of the variables."""
    levels = [each.distribution for each in variables]
    return [len(each.levels) for each in levels if isinstance(each, Levels)]


def nearest_grid(variables: Iterable[Variable], runs: int, *, repeats: bool) -> list[Variable]:
    """Return the variables with the levels that fit a number of runs best."""
    fitted = list(variables)
    points = math.prod(grid_shape(fitted))
    wanted = runs // max(1, repeats * runs // points)
    grids = [(n, g) for n, v in enumerate(fitted) if isinstance(g := v.distribution, Grid)]
    for left, (number, grid) in zip(range(len(grids), 0, -1), grids, strict=True):
        count = round(len(grid.levels) * (wanted / points) ** (1.0 / left))
        fitted[number] = replace(fitted[number], distribution=grid.with_count(count))
        points = math.prod(grid_shape(fitted))
    return fitted


_SAMPLINGS = {
    Sampling.RANDOM: 'independent random numbers',
    Sampling.LATIN_HYPERCUBE: 'Latin hypercube',
    Sampling.SOBOL: 'Sobol sequence, scrambled',
    Sampling.HALTON: 'Halton sequence, scrambled',
    Sampling.GRID: 'grid of all combinations',
}
_SHOWN_LEVELS = 6


@dataclass(frozen=True)
class StudyText:
    """What a study is for, and how its values were drawn.

    Attributes
    ----------
    is_grid : bool
        Whether the runs are all combinations of levels.
    distributions : mapping of str to str
        Distribution of each variable, in words.
    logarithmic : frozenset of str
        Variables whose logarithms are uniform.
    redesign : str
        How the gains of each robot are designed; empty if all have the same.
    """

    purpose: str
    sampling: str
    is_grid: bool
    distributions: Mapping[str, str]
    logarithmic: frozenset[str]
    redesign: str

    @classmethod
    def of(cls, text: str) -> StudyText:
        """Read the text of a study that has run, so that it is valid."""
        data = yaml.safe_load(text)
        varied = data.get('vary', {})
        sampling = Sampling(data.get('sampling', Sampling.RANDOM.value))
        return cls(
            printable(str(data.get('purpose', ''))),
            _SAMPLINGS[sampling],
            sampling is Sampling.GRID,
            {name: _words(each) for name, each in varied.items()},
            frozenset(name for name, each in varied.items() if LOG_UNIFORM in each),
            _design_words(data.get('redesign', '')),
        )


def _words(given: Mapping[str, object]) -> str:
    """Return a distribution in words."""
    kind = next(each for each in DISTRIBUTIONS if each in given)
    values = given[kind]
    items = [_number(each) for each in values] if isinstance(values, list) else [str(values)]
    if kind == LIST:
        more = ' …' if len(items) > _SHOWN_LEVELS else ''
        return f'one of {", ".join(items[:_SHOWN_LEVELS])}{more}'
    if kind == GRID:
        return f'levels at equal distances, {items[0]} … {items[1]}'
    if kind == NORMAL:
        limits = [f'{key} {_number(given[key])}' for key in ('min', 'max') if key in given]
        return ', '.join([f'normal, {items[0]} ± {items[1]}', *limits])
    return f'{kind.replace("_", "-")}, {items[0]} … {items[1]}'


def _design_words(given: object) -> str:
    """Return how gains are designed, in words."""
    pairs = given.items() if isinstance(given, dict) else [('method', given)]
    return printable(', '.join(f'{key} {value}' for key, value in pairs if value))


def _number(value: object) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    text = f'{value:g}' if isinstance(value, int | float) else printable(str(value))
    return text.replace('-', '−') if isinstance(value, int | float) else text
