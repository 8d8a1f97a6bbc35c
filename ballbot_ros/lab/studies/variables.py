"""What can vary from run to run of a study, by its name, and the distributions of values."""

from __future__ import annotations

import math
from collections.abc import Hashable, Mapping
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from ballbot_ros.controllers.controller_program import design, own_rows
from ballbot_ros.engine.rows import Column, robot_parameter, split_element
from ballbot_ros.engine.scenario.reader import ExpectationReader, Keys
from ballbot_ros.errors import StudyError
from ballbot_ros.lab.studies.events import FAULT, event_part, is_event, value_in
from ballbot_ros.lab.studies.programs import with_values
from ballbot_ros.parameters import (
    CONTROLLER,
    PLANT,
    ROBOT_CLASSES,
    SONAR,
    ControllerParameters,
    Parameter,
    ParameterSet,
    is_own,
    parameters_of,
    suggest,
)
from ballbot_ros.robot.arithmetic import Floats
from ballbot_ros.robot.brick.faults import OWN_TASK, TASKS, all_faults
from ballbot_ros.run.spec import RunSpec

MAX_LEVELS = 100_000
"""Largest number of values of one variable in a grid."""


@dataclass(frozen=True)
class _Limited:
    """What lies between two values."""

    low: float
    high: float

    @property
    def ends(self) -> tuple[Any, Any]:
        """The smallest and the largest value."""
        return self.low, self.high


class Uniform(_Limited):
    """Any number from `low` to `high`, with equal chances."""

    def values(self, shares: Floats) -> Floats:
        """Return the values for shares within [0, 1)."""
        return np.clip(self.low + shares * (self.high - self.low), self.low, self.high)


class LogUniform(_Limited):
    """Numbers from `low` to `high`, both positive, whose logarithms have equal chances."""

    def values(self, shares: Floats) -> Floats:
        """Return the values for shares within [0, 1)."""
        low, high = math.log(self.low), math.log(self.high)
        return np.clip(np.exp(low + shares * (high - low)), self.low, self.high)


@dataclass(frozen=True)
class Normal(_Limited):
    """A normal distribution of which only the part from `low` to `high` remains."""

    mean: float
    standard_deviation: float

    def values(self, shares: Floats) -> Floats:
        """Return the values for shares within [0, 1)."""
        from scipy.special import ndtr, ndtri

        below, above = ndtr([self._scaled(self.low), -self._scaled(self.high)])
        lower = below + shares * (1.0 - below - above)
        # Near 1 a share has few digits left, so take the distance from 1 instead.
        upper = above + (1.0 - shares) * (1.0 - below - above)
        scaled = np.where(lower < 0.5, ndtri(lower), -ndtri(upper))
        values: Floats = np.clip(self.mean + self.standard_deviation * scaled, self.low, self.high)
        return values

    def _scaled(self, value: float) -> float:
        return (value - self.mean) / self.standard_deviation


@dataclass(frozen=True)
class WholeNumbers(_Limited):
    """The values of another distribution, rounded to whole numbers from `low` to `high`.

    That of ``whole_numbers`` reaches half a number farther, so that the ends are not rarer.
    """

    low: int
    high: int
    rounded: Uniform | LogUniform | Normal

    def values(self, shares: Floats) -> NDArray[np.int64]:
        """Return the values for shares within [0, 1)."""
        # Above 2^53 a float is no exact whole number; the largest float below 2^63 fits.
        rounded = np.minimum(np.rint(self.rounded.values(shares)), np.nextafter(2.0**63, 0.0))
        return np.clip(rounded.astype(np.int64), self.low, self.high)


def whole_numbers(given: Uniform | LogUniform | Normal) -> WholeNumbers:
    """Return the whole numbers of a distribution whose ends are whole numbers."""
    low, high = int(given.low), int(given.high)
    wider: Uniform | LogUniform | Normal
    if isinstance(given, Normal):
        wider = Normal(low - 0.5, high + 0.5, given.mean, given.standard_deviation)
    else:
        wider = type(given)(low - 0.5, high + 0.5)
    return WholeNumbers(low, high, wider)


@dataclass(frozen=True)
class Levels:
    """A few numbers, switches or words, with equal chances."""

    levels: tuple[Any, ...]

    @property
    def ends(self) -> tuple[Any, Any]:
        """The smallest and the largest value."""
        return min(self.levels), max(self.levels)

    def values(self, shares: Floats) -> Column:
        """Return the values for shares within [0, 1)."""
        numbers = np.floor(shares * len(self.levels)).astype(np.int64)
        return self.at(np.minimum(numbers, len(self.levels) - 1))

    def at(self, numbers: NDArray[np.int64]) -> Column:
        """Return the values with these numbers, from 0."""
        return np.array(self.levels)[numbers]


class Grid(Levels):
    """Real numbers at equal distances, of which there may be more or fewer."""

    def with_count(self, count: int) -> Grid:
        """Return so many numbers with the same ends."""
        return Grid(tuple(np.linspace(*self.ends, min(max(2, count), MAX_LEVELS)).tolist()))


Distribution = Uniform | LogUniform | Normal | WholeNumbers | Levels
"""Each has the `ends` of its values, and `values` by its quantile function."""

UNIFORM, LOG_UNIFORM, NORMAL, LIST, GRID = 'uniform', 'log_uniform', 'normal', 'list', 'grid'
ALL = 'all'  # in place of the values of a list: all words that there are
DISTRIBUTIONS = (UNIFORM, LOG_UNIFORM, NORMAL, LIST, GRID)


class DistributionReader(ExpectationReader):
    """Reads documents with distributions."""

    def _distribution(self, data: object, keys: Keys, parameter: Parameter) -> Distribution:
        """Return a distribution whose values are all allowed for a parameter."""
        given = self._mapping(data, keys, (*DISTRIBUTIONS, 'min', 'max'))
        kinds = [each for each in DISTRIBUTIONS if each in given]
        if len(kinds) != 1:
            raise self._error(
                keys, f'{parameter.name} needs exactly one of {", ".join(DISTRIBUTIONS)}'
            )
        kind = kinds[0]
        if kind != NORMAL:
            for key in ('min', 'max'):
                if key in given:
                    raise self._error((*keys, key), f'{key} is only for {NORMAL}')
        at = (*keys, kind)
        if kind == LIST:
            return self._list(given[kind], at, parameter)
        is_number = isinstance(parameter.default, int | float)
        if isinstance(parameter.default, bool) or parameter.choices or not is_number:
            raise self._error(at, f'{parameter.name} can only vary by {LIST}')
        if kind == GRID:
            return self._grid(given[kind], at, parameter)
        continuous = (
            self._normal(given, keys, parameter)
            if kind == NORMAL
            else self._range(given[kind], at, parameter)
        )
        return whole_numbers(continuous) if isinstance(parameter.default, int) else continuous

    def _list(self, data: object, keys: Keys, parameter: Parameter) -> Levels:
        data = list(parameter.choices) if data == ALL and parameter.choices else data
        levels = self._each(data, keys, lambda item, at: self._allowed(item, at, parameter))
        if not levels:
            raise self._error(keys, f'{parameter.name}: the list is empty')
        known = set()
        for index, value in enumerate(levels):
            if value in known:
                raise self._error((*keys, index), f'{parameter.name}: {value!r} is doubled')
            known.add(value)
        return Levels(tuple(levels))

    def _grid(self, data: object, keys: Keys, parameter: Parameter) -> Levels:
        if not isinstance(data, list) or len(data) != 3:
            raise self._error(keys, f'{GRID} is not a list [first, last, number of levels]')
        first, last = self._ends(data[:2], keys, parameter)
        number = data[2]
        if isinstance(number, bool) or not isinstance(number, int) or not 2 <= number <= MAX_LEVELS:
            raise self._error(keys, f'{number!r} is not a whole number of levels, 2 … {MAX_LEVELS}')
        levels = np.linspace(first, last, number).tolist()
        if isinstance(parameter.default, int):
            broken = [each for each in levels if each % 1]
            if broken:
                raise self._error(
                    keys, f'{parameter.name}: the level {broken[0]:g} is not a whole number'
                )
            levels = [int(each) for each in levels]
        if any(after <= before for before, after in pairwise(levels)):
            raise self._error(keys, f'{parameter.name}: the levels are too close to each other')
        return (Grid if isinstance(parameter.default, float) else Levels)(tuple(levels))

    def _range(self, data: object, keys: Keys, parameter: Parameter) -> Uniform | LogUniform:
        if not isinstance(data, list) or len(data) != 2:
            raise self._error(keys, f'{keys[-1]} is not a pair [lowest, highest]')
        low, high = self._ends(data, keys, parameter)
        if keys[-1] == UNIFORM:
            return Uniform(low, high)
        if low <= 0:
            raise self._error(keys, f'{parameter.name}: {LOG_UNIFORM} needs ends above 0')
        return LogUniform(low, high)

    def _ends(self, data: list[object], keys: Keys, parameter: Parameter) -> tuple[float, float]:
        low, high = (self._allowed(value, keys, parameter) for value in data)
        if not low < high:
            raise self._error(keys, f'{parameter.name}: the range {low:g} … {high:g} is empty')
        return low, high

    def _normal(self, given: Mapping[str, object], keys: Keys, parameter: Parameter) -> Normal:
        at = (*keys, NORMAL)
        pair = given[NORMAL]
        if not isinstance(pair, list) or len(pair) != 2:
            raise self._error(at, f'{NORMAL} is not a pair [mean, standard deviation]')
        mean, deviation = (self._number(each, at) for each in pair)
        if deviation <= 0.0:
            raise self._error(at, f'{parameter.name}: the standard deviation is not above 0')
        limits = parameter.bounds
        low, high = (
            self._allowed(given[key], (*keys, key), parameter)
            if key in given
            else (limits[end] if limits else math.nan)
            for end, key in enumerate(('min', 'max'))
        )
        if math.isnan(low) or math.isnan(high):
            raise self._error(at, f'{parameter.name} has no bounds: {NORMAL} needs min and max')
        if not low < high:
            raise self._error(keys, f'{parameter.name}: the range {low:g} … {high:g} is empty')
        if not low <= mean <= high:
            raise self._error(
                at, f'{parameter.name}: the mean {mean:g} is not within {low:g} … {high:g}'
            )
        return Normal(low, high, mean, deviation)

    def _allowed(self, value: object, keys: Keys, parameter: Parameter) -> Any:
        """Return a value in the parameter's own type."""
        return cast(Any, parameter.check(value, f'{self._document.where(*keys)}: '))


SEED = f'{PLANT}.seed'
DURATION = f'{PLANT}.duration'
CONE_RAYS = f'{SONAR}.cone_rays'

WITHOUT_EFFECT = frozenset(
    {
        'lockstep', 'real_time_factor', 'timeout', 'startup_timeout', 'on_timeout',
        'require_recorder', 'rejoin', 'push_duration', 'lsb', 'sound_freq',
        'sound_dur', 'sound_volume', 'log_content',
    }
)  # fmt: skip
"""Parameters on which the motion of a run does not depend: pace, graph, sound and log."""

_ROBOT_NODES = frozenset(cls.node for cls in ROBOT_CLASSES)
_SAME_IN_ALL = frozenset(
    name
    for node in _ROBOT_NODES
    for name, each in parameters_of(node).items()
    if isinstance(each.default, str) and not each.choices
)
"""Texts, which can't vary."""


@dataclass(frozen=True)
class Variable:
    """A number, switch or word that varies from run to run.

    Attributes
    ----------
    name : str
        ``node.param``, ``push.NUMBER.field``, ``fault.NUMBER.field`` or
        ``stick.STICK.SEGMENT.field``.
    parameter : Parameter
        Its type, unit and bounds; it has the variable's name.
    """

    name: str
    parameter: Parameter
    distribution: Distribution


def find_variable(name: str, spec: RunSpec) -> Parameter:
    """Return the parameter of a variable, with the variable's name.

    It raises BallbotError if there is no such variable, or it has no effect; the message is one
    line without a place.
    """
    if is_event(name):
        part = event_part(name, spec.scenario)
        own = set(spec.scenario.faults)
        if part.owner == FAULT and set(all_faults(spec.parameters.of)) != own:
            raise StudyError(f"{name} cannot vary: the scenario's faults are set as parameters")
        tasks = [each.name for each in spec.controller.tasks] if spec.controller else TASKS
        others = {*TASKS, OWN_TASK}.difference(tasks)  # of other controllers
        choices = part.parameter.choices
        known = tuple(each for each in choices if str(each).split()[0] not in others)
        return replace(part.parameter, name=name, choices=known)
    node, _, rest = name.partition('.')
    if node == CONTROLLER and is_own(rest):
        return replace(_own_parameter(rest, spec), name=name)
    parameter = replace(robot_parameter(name), name=name)
    if rest in WITHOUT_EFFECT:
        raise StudyError(f'{name} cannot vary: the motion of a run does not depend on it')
    if isinstance(parameter.default, tuple):
        last = len(parameter.default)
        raise StudyError(f'{name} cannot vary as a whole; its elements can: {name}.1 … {last}')
    return parameter


def nominal_value(spec: RunSpec, variable: Variable) -> Any:
    """Return the value of a variable in the run that all are like; None if it has none there."""
    name = variable.name
    if is_event(name):
        return value_in(spec.scenario, event_part(name, spec.scenario))
    whole, element = split_element(name)
    node, _, rest = whole.partition('.')
    if node == CONTROLLER and is_own(rest):
        return spec.parameters.undeclared.get(rest, variable.parameter.default)
    value: Any = spec.parameters.of_node(node).values()[rest]
    return value if element is None else value[element]


def _own_parameter(name: str, spec: RunSpec) -> Parameter:
    if spec.controller is None:
        raise StudyError(f"{CONTROLLER}.{name}: the document's controller has no such parameter")
    rows = {row.name: row for row in own_rows(spec.controller)}
    row = rows.get(name)
    if row is None:
        raise StudyError(f'{CONTROLLER} has no parameter {name!r}; {suggest(name, rows)}')
    if row.is_designed or isinstance(row.default, tuple):
        raise StudyError(f'{CONTROLLER}.{name} cannot vary: it is a list of numbers')
    settings = spec.parameters.of(ControllerParameters)
    again = with_values(spec.parameters, {f'{CONTROLLER}.{name}': settings.values()[name]})
    design(spec.controller, again)
    for each, value in again.of(ControllerParameters).own:
        if value != settings.values()[each]:
            raise StudyError(
                f'{CONTROLLER}.{name} cannot vary: {CONTROLLER}.{each} is set, which is designed '
                'for each run: omit it'
            )
    return row


def identity(name: str, parameter: Parameter) -> Hashable:
    """Return what two variables have in common if they are the same parameter."""
    return (parameter.nodes, name.partition('.')[2]) if parameter.nodes else name


def fixed_identities(parameters: ParameterSet) -> frozenset[Hashable]:
    """Return the identities of the parameters of robots that are set."""
    fixed: set[Hashable] = set()
    for node, name, value in parameters:
        if node not in _ROBOT_NODES or name in _SAME_IN_ALL:
            continue
        target = f'{node}.{name}'
        names = [target]
        if isinstance(value, tuple):
            names += [f'{target}.{number}' for number in range(1, len(value) + 1)]
        fixed |= {identity(each, robot_parameter(each)) for each in names}
    fixed |= {((CONTROLLER,), name) for name in parameters.undeclared}
    return frozenset(fixed)
