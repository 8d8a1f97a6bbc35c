"""Parts of scenario files and the like; every error message names file and line."""

from __future__ import annotations

import math
import reprlib
from collections.abc import Callable, Collection, Hashable, Mapping
from typing import ClassVar, TypeVar, cast

from ballbot_ros.errors import BallbotError
from ballbot_ros.parameters import PlantParameters
from ballbot_ros.scenario.errors import ScenarioError
from ballbot_ros.scenario.metrics import METRICS
from ballbot_ros.scenario.scenario import Expectation
from ballbot_ros.yaml_document import YamlDocument

Keys = tuple[Hashable, ...]
_Part = TypeVar('_Part')


class DocumentReader:
    """Reads and checks the parts of a document.

    Attributes
    ----------
    what : str
        What the document describes, for error messages.
    error_class : type
        The class of its errors.
    """

    what: ClassVar[str] = 'the scenario'
    error_class: ClassVar[type[BallbotError]] = ScenarioError

    def __init__(self, document: YamlDocument) -> None:
        self._document = document

    def _mapping(
        self, data: object, keys: Keys, allowed: Collection[str] | None = None
    ) -> Mapping[str, object]:
        if not isinstance(data, dict):
            raise self._error(keys, f'{self._label(keys)} is not a mapping (`key: value`)')
        for key in data:
            if allowed is not None and key not in allowed:
                words = ', '.join(sorted(allowed))
                raise self._error((*keys, key), f'unknown key {key!r}; known: {words}')
        # A key that is not text is refused as unknown, if not above, then by the caller.
        return cast('Mapping[str, object]', data)

    def _each(self, data: object, keys: Keys, read: Callable[[object, Keys], _Part]) -> list[_Part]:
        if not isinstance(data, list):
            raise self._error(keys, f'{self._label(keys)} is not a list')
        return [read(item, (*keys, index)) for index, item in enumerate(data)]

    def _number(self, value: object, keys: Keys) -> float:
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise self._error(keys, f'{self._label(keys)}: {value!r} is not a number')
        if not math.isfinite(value):
            raise self._error(keys, f'{self._label(keys)}: {value!r} is not finite')
        return float(value)

    def _check_lines_of_text(self, data: Mapping[str, object], keys: Collection[str]) -> None:
        """Refuse a value under one of the keys that is not a line of text."""
        for key in keys:
            if key not in data:
                continue
            value = data[key]
            if not isinstance(value, str) or len(value.splitlines()) != 1:
                raise self._error((key,), f'{key}: {value!r} is not a line of text')

    def _error(self, keys: Keys, text: str) -> BallbotError:
        return self.error_class(f'{self._document.where(*keys)}: {text}')

    def _label(self, keys: Keys) -> str:
        """Return the name of a part of the file: its key, and its index in a list."""
        names = [key for key in keys if isinstance(key, str)]
        if not names:
            return self.what
        last = len(keys) - 1 - keys[::-1].index(names[-1])
        return reprlib.repr(names[-1]) + ''.join(
            f' {int(cast(int, index)) + 1}' for index in keys[last + 1 :]
        )


class ExpectationReader(DocumentReader):
    """Reads documents with expectations."""

    def _expectations(self, data: object, plant: PlantParameters) -> list[Expectation]:
        expectations: list[Expectation] = []
        for metric, bounds in self._mapping(data, ('expectations',)).items():
            keys: Keys = ('expectations', metric)
            if metric not in METRICS:
                known = ', '.join(METRICS)
                raise self._error(keys, f'unknown metric {metric!r}; known: {known}')
            if metric == 'wall_clearance_m' and not plant.map:
                raise self._error(keys, f'{metric} needs a map')

            def read(item: object, at: Keys) -> Expectation:
                return self._expectation(at, item, plant)

            if isinstance(bounds, list):
                if not bounds:
                    raise self._error(keys, f'{metric} has neither min nor max')
                expectations += self._each(bounds, keys, read)
            else:
                expectations.append(read(bounds, keys))
        return expectations

    def _expectation(self, keys: Keys, data: object, plant: PlantParameters) -> Expectation:
        metric = str(keys[1])
        limits = {
            key: self._number(value, (*keys, key))
            for key, value in self._mapping(data, keys, ('min', 'max', 'from', 'to')).items()
        }
        if 'min' not in limits and 'max' not in limits:
            raise self._error(keys, f'{metric} has neither min nor max')
        low, high = limits.get('min', -math.inf), limits.get('max', math.inf)
        if low > high:
            raise self._error(keys, f'{metric}: min {low:g} is more than max {high:g}')
        start, end = limits.get('from', 0.0), limits.get('to', math.inf)
        expectation = Expectation(metric, limits.get('min'), limits.get('max'), start, end)
        if fault := window_fault(expectation, plant):
            raise self._error(keys, fault)
        return expectation


def window_fault(expectation: Expectation, plant: PlantParameters) -> str:
    """Return why the window of an expectation is not possible in a run; '' if it is."""
    start, end, duration = expectation.start, expectation.end, plant.duration
    if not 0.0 <= start < min(end, duration) or duration < end < math.inf:
        return (
            f'{expectation.metric}: the window {start:g} … {end:g} s is empty or not within the '
            f'run, 0 … {duration:g} s'
        )
    if end < plant.hold_time:
        return f'{expectation.metric}: the window ends before the release at {plant.hold_time:g} s'
    return ''
