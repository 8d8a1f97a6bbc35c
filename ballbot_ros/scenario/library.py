"""Scenario files: finding, reading and checking them."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from ballbot_ros.errors import BallbotError
from ballbot_ros.parameter_file import read_parameter_file
from ballbot_ros.parameters import GYRO, PLANT, ParameterSet
from ballbot_ros.scenario.metrics import METRICS
from ballbot_ros.scenario.scenario import Expectation, Scenario, ScheduledPush
from ballbot_ros.scenario.signal import Signal
from ballbot_ros.share import share_directory
from ballbot_ros.yaml_document import YamlDocument

STICK_LIMIT = 100
IDEAL = 'ideal'


class ScenarioError(BallbotError):
    """An unknown scenario, or a file that does not describe one."""


def scenario_names() -> list[str]:
    """Return the names of the shipped scenarios."""
    return sorted(path.stem for path in (share_directory() / 'config/scenarios').glob('*.yaml'))


def load_scenario(name_or_file: str) -> Scenario:
    """Read a shipped scenario by its name, or a file by its path.

    Raises
    ------
    ScenarioError, YamlError, ParameterError
        One line that names the file and line, the key, and what is allowed.
    """
    shipped = share_directory() / 'config/scenarios' / f'{name_or_file}.yaml'
    if name_or_file in scenario_names():
        path = shipped
    elif name_or_file.endswith(('.yaml', '.yml')) or '/' in name_or_file:
        path = Path(name_or_file)
    else:
        raise ScenarioError(
            f'unknown scenario {name_or_file!r}; shipped: {", ".join(scenario_names())} '
            '(a file of your own: give its path, ending in .yaml)'
        )
    return _Reader(YamlDocument(path)).scenario()


def load_profile(name: str) -> ParameterSet:
    """Return what the profile `name` sets: nothing for ``ideal``, which the defaults are.

    Raises
    ------
    ScenarioError
        If there is no such profile.
    """
    if name == IDEAL:
        return ParameterSet()
    folder = share_directory() / 'config/profiles'
    known = [path.stem for path in sorted(folder.glob('*.yaml'))]
    if name not in known:
        raise ScenarioError(f'unknown profile {name!r}; known: {", ".join((IDEAL, *known))}')
    return read_parameter_file(folder / f'{name}.yaml')


class _Reader:
    """Checks one document; every complaint names file and line."""

    def __init__(self, document: YamlDocument) -> None:
        self._document = document

    def scenario(self) -> Scenario:
        keys = {
            'purpose', 'duration', 'seed', 'profile', 'start', 'sticks', 'pushes', 'parameters',
            'expectations',
        }  # fmt: skip
        data = self._mapping(self._document.data, (), keys)
        for required in ('purpose', 'duration'):
            if required not in data:
                raise self._error((), f'{required} is missing')
        if not isinstance(data['purpose'], str):
            raise self._error(('purpose',), f'{data["purpose"]!r} is not text')
        profile = str(data.get('profile', IDEAL))
        try:
            parameters = load_profile(profile)
        except ScenarioError as error:
            raise self._error(('profile',), str(error)) from None
        self._set(parameters, PLANT, 'duration', data['duration'], ('duration',))
        if parameters.values(PLANT)['duration'] == 0.0:
            raise self._error(('duration',), 'a scenario lasts longer than 0 s')
        if 'seed' in data:
            self._set(parameters, GYRO, 'seed', data['seed'], ('seed',))
        self._start(parameters, data.get('start', {}))
        for node, values in self._mapping(data.get('parameters', {}), ('parameters',)).items():
            for name, value in self._mapping(values, ('parameters', node)).items():
                self._set(parameters, node, name, value, ('parameters', node, name))
        sticks = self._mapping(data.get('sticks', {}), ('sticks',), {'vertical', 'horizontal'})
        return Scenario(
            name=self._document.path.stem,
            purpose=str(data['purpose']),
            profile=profile,
            parameters=parameters,
            vertical=self._signal(sticks.get('vertical', []), ('sticks', 'vertical')),
            horizontal=self._signal(sticks.get('horizontal', []), ('sticks', 'horizontal')),
            pushes=tuple(self._each(data.get('pushes', []), ('pushes',), self._push)),
            expectations=tuple(self._expectations(data.get('expectations', {}))),
            text=self._document.path.read_text(encoding='utf-8'),
        )

    def _start(self, parameters: ParameterSet, data: Any) -> None:
        degrees = {'pitch_x_deg': 'start_pitch_x', 'pitch_y_deg': 'start_pitch_y'}
        metres = {'position_x': 'start_position_x', 'position_y': 'start_position_y'}
        for key, value in self._mapping(data, ('start',), {*degrees, *metres}).items():
            number = self._number(value, ('start', key))
            if key in degrees:
                self._set(parameters, PLANT, degrees[key], math.radians(number), ('start', key))
            else:
                self._set(parameters, PLANT, metres[key], number, ('start', key))

    def _signal(self, data: Any, keys: tuple[Any, ...]) -> Signal:
        points = self._each(data, keys, self._point)
        for index in range(1, len(points)):
            if points[index][0] < points[index - 1][0]:
                raise self._error((*keys, index), f'time goes back to {points[index][0]:g} s')
        return Signal(tuple(points))

    def _point(self, data: Any, keys: tuple[Any, ...]) -> tuple[float, float]:
        if not isinstance(data, list) or len(data) != 2:
            raise self._error(keys, f'{data!r} is not a pair [time, value]')
        time, value = (self._number(item, keys) for item in data)
        if time < 0.0:
            raise self._error(keys, f'{time:g} s is before the start')
        if abs(value) > STICK_LIMIT:
            raise self._error(keys, f'{value:g} is not within -{STICK_LIMIT} … {STICK_LIMIT}')
        return time, value

    def _push(self, data: Any, keys: tuple[Any, ...]) -> ScheduledPush:
        values = self._mapping(data, keys, {'time', 'duration', 'force_x', 'force_y'})
        numbers = {key: self._number(value, (*keys, key)) for key, value in values.items()}
        for required in ('time', 'duration'):
            if numbers.get(required, -1.0) < 0.0:
                raise self._error(keys, f'a push has a {required} of 0 s or more')
            if numbers[required] > 1e6:
                raise self._error(keys, f'a push has a {required} of 1e6 s or less')
        for force in ('force_x', 'force_y'):
            if abs(numbers.get(force, 0.0)) > 1e3:
                raise self._error((*keys, force), 'a push has a force within -1000 … 1000 N')
        return ScheduledPush(**numbers)

    def _expectations(self, data: Any) -> list[Expectation]:
        expectations = []
        for metric, bounds in self._mapping(data, ('expectations',)).items():
            keys = ('expectations', metric)
            if metric not in METRICS:
                known = ', '.join(METRICS)
                raise self._error(keys, f'unknown metric {metric!r}; known: {known}')
            limits = {
                key: self._number(value, (*keys, key))
                for key, value in self._mapping(bounds, keys, {'min', 'max'}).items()
            }
            if not limits:
                raise self._error(keys, f'{metric} has neither min nor max')
            expectations.append(Expectation(metric, limits.get('min'), limits.get('max')))
        return expectations

    def _mapping(
        self, data: Any, keys: tuple[Any, ...], allowed: set[str] | None = None
    ) -> Mapping[Any, Any]:
        if not isinstance(data, dict):
            what = repr(keys[-1]) if keys else 'the scenario'
            raise self._error(keys, f'{what} is not a mapping of names')
        for key in data:
            if allowed is not None and key not in allowed:
                words = ', '.join(sorted(allowed))
                raise self._error((*keys, key), f'unknown key {key!r}; known: {words}')
        return data

    def _each(
        self, data: Any, keys: tuple[Any, ...], read: Callable[[Any, tuple[Any, ...]], Any]
    ) -> list[Any]:
        if not isinstance(data, list):
            raise self._error(keys, f'{keys[-1]} is not a list')
        return [read(item, (*keys, index)) for index, item in enumerate(data)]

    def _number(self, value: Any, keys: tuple[Any, ...]) -> float:
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise self._error(keys, f'{value!r} is not a number')
        if not math.isfinite(value):
            raise self._error(keys, f'{value!r} is not finite')
        return float(value)

    def _set(
        self, parameters: ParameterSet, node: Any, name: Any, value: Any, keys: tuple[Any, ...]
    ) -> None:
        parameters.set(str(node), str(name), value, self._document.where(*keys))

    def _error(self, keys: tuple[Any, ...], text: str) -> ScenarioError:
        return ScenarioError(f'{self._document.where(*keys)}: {text}')
