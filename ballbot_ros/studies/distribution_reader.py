"""Reading the distributions in study files."""

from __future__ import annotations

import math
from collections.abc import Mapping
from itertools import pairwise
from typing import Any, cast

import numpy as np

from ballbot_ros.parameters import Parameter
from ballbot_ros.scenario.document_reader import ExpectationReader, Keys
from ballbot_ros.studies.distributions import (
    MAX_LEVELS,
    Distribution,
    Grid,
    Levels,
    LogUniform,
    Normal,
    Uniform,
    whole_numbers,
)

UNIFORM, LOG_UNIFORM, NORMAL, LIST, GRID = 'uniform', 'log_uniform', 'normal', 'list', 'grid'
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

    def _ends(self, data: list[Any], keys: Keys, parameter: Parameter) -> tuple[float, float]:
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
        return Normal(mean, deviation, low, high)

    def _allowed(self, value: object, keys: Keys, parameter: Parameter) -> Any:
        """Return a value in the parameter's own type."""
        return cast(Any, parameter.check(value, f'{self._document.where(*keys)}: '))
