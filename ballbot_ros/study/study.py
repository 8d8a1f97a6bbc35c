"""Studies: what varies from run to run of a scenario, and what is measured."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ballbot_ros.run.spec import RunOptions, RunSpec
from ballbot_ros.scenario.scenario import Expectation, Measure
from ballbot_ros.scenario.writer import scenario_data
from ballbot_ros.study.distributions import Levels
from ballbot_ros.study.events import EventPart
from ballbot_ros.study.rows import whole_values
from ballbot_ros.study.runs import Samples, scenarios_of_runs
from ballbot_ros.study.variables import DURATION, SEED, Variable
from ballbot_ros.text_enum import TextEnum

MAX_RUNS = 10**9
"""Largest number of runs of a study."""


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
    path : Path
        The file.
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
    options : RunOptions
        The options that make the scenario the study's run, with the study's fixed values.
    scenario : str
        Name of a shipped scenario, or the path of a file.
    spec : RunSpec
        The run that all are like, but for their samples.
    """

    name: str
    purpose: str
    path: Path
    text: str
    runs: int
    seed: int
    sampling: Sampling
    variables: tuple[Variable, ...]
    draws_seeds: bool
    metrics: tuple[str, ...]
    expectations: tuple[Expectation, ...]
    options: RunOptions
    scenario: str
    spec: RunSpec

    @property
    def measures(self) -> tuple[Measure, ...]:
        """What is measured: the metrics of the whole run, then the windows of expectations."""
        whole = [Measure(metric) for metric in self.metrics]
        windows = [each.measure for each in self.expectations]
        return tuple(dict.fromkeys([*whole, *windows]))

    @property
    def columns(self) -> tuple[str, ...]:
        """The names of what distinguishes the runs: the variables, and the seed if it is drawn."""
        names = tuple(each.name for each in self.variables)
        return (*names, SEED) if self.draws_seeds else names

    @property
    def points(self) -> int:
        """The number of points of the grid; for other samplings the number of runs."""
        if self.sampling is not Sampling.GRID:
            return self.runs
        return grid_points(self.variables)

    @cached_property
    def parts(self) -> Mapping[str, EventPart]:
        """The variables that are parts of pushes and sticks."""
        return {each.name: each.part for each in self.variables if each.part is not None}

    def samples(self, columns: Mapping[str, NDArray[Any]], first: int = 0) -> Samples:
        """Return the samples of consecutive runs, given the values of all of :attr:`columns`.

        Parameters
        ----------
        columns : mapping of str to ndarray
            Each (r,).
        first : int
            Number of the first run, for error messages.
        """
        count = len(columns[self.columns[0]])
        values = {name: columns[name] for name in self.columns if name not in self.parts}
        events = {name: columns[name] for name in self.parts}
        return Samples(count, values, events=events, first=first)

    def run_options(self, row: Mapping[str, object]) -> RunOptions:
        """Return the options that make :meth:`scenario_data` of the same values a run again.

        Parameters
        ----------
        row : mapping of str to object
            The values of all of :attr:`columns`.
        """
        varied = {name: _plain(row[name]) for name in self.columns if name not in self.parts}
        values = whole_values(self.spec.parameters, varied)
        return replace(self.options, values={**self.options.values, **values})

    def scenario_data(self, row: Mapping[str, object]) -> dict[str, Any]:
        """Return the content of a scenario file for a run, for the same arguments.

        Sticks and pushes are those of the run, to the bit. The expectations are the study's.
        """
        columns = {name: np.array([row[name]]) for name in self.columns}
        scenarios = scenarios_of_runs(self.spec, self.samples(columns))
        scenario = scenarios[0] if scenarios else self.spec.scenario
        data = scenario_data(replace(scenario, expectations=self.expectations))
        data['duration'] = _plain(row.get(DURATION, self.spec.plant.duration))
        return data


def grid_points(variables: tuple[Variable, ...]) -> int:
    """Return the number of combinations of the levels of all variables."""
    levels = [each.distribution for each in variables]
    return math.prod(len(each.levels) for each in levels if isinstance(each, Levels))


def _plain(value: object) -> object:
    """Return a value without numpy's type."""
    return value.item() if isinstance(value, np.generic) else value
