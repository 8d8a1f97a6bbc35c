"""Scenarios: the shipped ones and those of files, read and checked."""

from __future__ import annotations

import math
import reprlib
from collections.abc import Callable, Collection, Hashable, Mapping
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace
from typing import Any, ClassVar, TypeVar, cast

from ballbot_ros.controllers.loading import resolve_reference
from ballbot_ros.engine.scenario.metrics import METRICS
from ballbot_ros.engine.scenario.properties import Events, Property
from ballbot_ros.engine.scenario.property_language import parse_property
from ballbot_ros.engine.scenario.scenario import (
    PUSH_DIRECTIONS,
    Expectation,
    Scenario,
    ScheduledPush,
    Segment,
    StickSignal,
    push_fault,
    segment_fault,
)
from ballbot_ros.errors import BallbotError, ScenarioError, WorldError, did_you_mean
from ballbot_ros.files import read_text, share_directory, shipped_names
from ballbot_ros.parameters import (
    CONTROLLER,
    GYRO,
    PLANT,
    ParameterError,
    ParameterSet,
    PlantParameters,
    Value,
    parameters_of,
)
from ballbot_ros.parameters.changes import IMPLEMENTATION, TimedChange, changes_text, checked_change
from ballbot_ros.parameters.files import leaves, plain_value, read_parameter_file
from ballbot_ros.parameters.yaml_document import YamlDocument, is_yaml_path, yaml_text
from ballbot_ros.robot.brick.faults import Fault, fault_texts
from ballbot_ros.robot.plant.ground_truth import FORCE_LIMIT
from ballbot_ros.robot.world.floor_map import is_file_name, load_map
from ballbot_ros.robot.world.world import World

Keys = tuple[Hashable, ...]
_Part = TypeVar('_Part')


class DocumentReader:
    """Reads and checks the parts of a document; errors say `what` it describes."""

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
    """Reads documents with faults, expectations and properties."""

    def _faults(self, data: Mapping[str, object], duration: float) -> tuple[Fault, ...]:
        faults = self._each(data.get('faults', []), ('faults',), self._fault)
        for index, each in enumerate(faults):
            if each.time >= duration:
                raise self._error(('faults', index), 'a fault begins after the end of the run')
        return tuple(faults)

    def _fault(self, data: object, keys: Keys) -> Fault:
        names = ('component', 'type', 'time', 'duration', 'amount')
        values: Mapping[str, Any] = self._mapping(data, keys, names)
        for required in names[:2]:
            if required not in values:
                raise self._error(keys, f'a fault needs a {required}')
        try:
            return Fault(**values)
        except ParameterError as error:
            raise self._error(keys, str(error)) from None

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

    def _properties(
        self, data: object, plant: PlantParameters, events: Events
    ) -> tuple[Property, ...]:
        found: list[Property] = []
        for name, text in self._mapping(data, ('properties',)).items():
            keys: Keys = ('properties', name)
            if not isinstance(name, str) or not name.isprintable() or name in METRICS:
                raise self._error(keys, f'{name!r} is no name for a property')
            if not isinstance(text, str):
                raise self._error(keys, f'{name!r}: {text!r} is not a text')
            try:
                found.append(parse_property(name, ' '.join(text.split())))
            except ScenarioError as error:
                raise self._error(keys, f'{name!r}: {error}') from None
            if fault := found[-1].fault(events, has_map=bool(plant.map)):
                raise self._error(keys, f'{name!r}: {fault}')
        return tuple(found)

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


IDEAL = 'ideal'
STICK_LIMIT = 100
TIME_LIMIT = 1e6

_PARAMETERS = {
    'duration': (PLANT, 'duration'),
    'seed': (GYRO, 'seed'),
    'plant_model': (PLANT, 'plant_model'),
    'mode': (CONTROLLER, 'mode'),
}
_START = {
    'pitch_x_deg': 'start_pitch_x',
    'pitch_y_deg': 'start_pitch_y',
    'pitch_rate_x_deg_per_s': 'start_pitch_rate_x',
    'pitch_rate_y_deg_per_s': 'start_pitch_rate_y',
    'position_x': 'start_position_x',
    'position_y': 'start_position_y',
}
SCENARIO_KEYS = {
    'purpose', *_PARAMETERS, 'profile', 'map', 'start', 'sticks', 'pushes', 'changes', 'faults',
    'parameters', 'expectations', 'properties',
}  # fmt: skip


class ScenarioReader(ExpectationReader):
    """Reads and checks one document; `load_profile` returns the parameters of a profile.

    If `map_file` is given, it is read instead of any image that the document names.
    """

    def __init__(
        self,
        document: YamlDocument,
        load_profile: Callable[[str], ParameterSet],
        map_file: Path | None = None,
    ) -> None:
        super().__init__(document)
        self._load_profile = load_profile
        self._map_file = map_file

    def scenario(self, profile: str | None = None) -> Scenario:
        """Return the scenario in the document; `profile` replaces the document's device profile.

        It raises ScenarioError or ParameterError, on one line that names file and line.
        """
        data = self._mapping(self._document.data, (), SCENARIO_KEYS)
        for required in ('purpose', 'duration'):
            if required not in data:
                raise self._error((), f'{required} is missing')
        self._check_lines_of_text(data, ('purpose', 'profile'))
        given, values = self._profile(data)
        if profile is not None:
            given, values = profile, self._load_profile(profile)
        parameters = self._parameters(data, ParameterSet(values))
        plant = parameters.of(PlantParameters)
        # Parameters may shorten a run, which then does not reach everything.
        duration = max(plant.duration, float(cast(float, data['duration'])))
        sticks = self._mapping(data.get('sticks', {}), ('sticks',), ('vertical', 'horizontal'))
        scenario = Scenario(
            name=self._document.path.stem,
            purpose=str(data['purpose']),
            profile=IDEAL if is_yaml_path(given) else given,
            parameters=parameters,
            vertical=self._signal(sticks.get('vertical', []), ('sticks', 'vertical'), duration),
            horizontal=self._signal(
                sticks.get('horizontal', []), ('sticks', 'horizontal'), duration
            ),
            pushes=tuple(self._pushes(data.get('pushes', []), duration)),
            faults=self._faults(data, duration),
            expectations=tuple(self._expectations(data.get('expectations', {}), plant)),
            text=self._text(data, given, values),
        )
        properties = self._properties(data.get('properties', {}), plant, scenario.events)
        return replace(scenario, properties=properties)

    def _profile(self, data: Mapping[str, object]) -> tuple[str, ParameterSet]:
        """Return the document's device profile; a path is one from the document's folder."""
        name = str(data.get('profile', IDEAL))
        if is_yaml_path(name):
            name = str(self._document.path.parent / name)
        try:
            return name, self._load_profile(name)
        except BallbotError as error:
            raise self._error(('profile',), str(error)) from None

    def _text(self, data: Mapping[str, object], profile: str, values: ParameterSet) -> str:
        """Return a document like this one with a profile, which needs no other file for that."""
        if not is_yaml_path(profile):
            if profile == str(data.get('profile', IDEAL)):
                return read_text(self._document.path)
            return yaml_text({**data, 'profile': profile})
        keys = {*data, *cast('Mapping[str, object]', data.get('start', {}))}
        replaced = {name for key, (_, name) in _PARAMETERS.items() if key in keys}
        replaced |= {name for key, name in _START.items() if key in keys} | (keys & {'map'})
        nodes: dict[str, dict[str, object]] = {}
        for node, name, value in values:
            if name not in replaced:
                nodes.setdefault(node, {})[name] = plain_value(value)
        for node, own in cast('Mapping[str, Any]', data.get('parameters', {})).items():
            nodes[node] = {**nodes.pop(node, {}), **own}
        return yaml_text({**data, 'profile': IDEAL, 'parameters': nodes})

    def _parameters(self, data: Mapping[str, object], parameters: ParameterSet) -> ParameterSet:
        """Return the parameters of a profile with those of the document, which replace them."""
        for key, (node, name) in _PARAMETERS.items():
            if key in data:
                self._set(parameters, node, name, data[key], (key,))
        if parameters.of(PlantParameters).duration == 0.0:
            raise self._error(('duration',), 'a scenario must last longer than 0 s')
        if 'map' in data:
            self._set(parameters, PLANT, 'map', self._map(data['map']), ('map',))
        for key, value in self._mapping(data.get('start', {}), ('start',), _START).items():
            number = self._number(value, ('start', key))
            if '_deg' in key:
                number = self._radians(number, _START[key], ('start', key))
            self._set(parameters, PLANT, _START[key], number, ('start', key))
        if 'faults' in data:
            faults = self._faults(data, parameters.of(PlantParameters).duration)
            for node, text in fault_texts(faults).items():
                self._set(parameters, node, 'faults', text, ('faults',))
        for node, values in self._mapping(data.get('parameters', {}), ('parameters',)).items():
            for inner, name, value in leaves(self._mapping(values, ('parameters', node))):
                keys = ('parameters', node, *inner)
                if name == 'scenario':
                    raise self._error(keys, 'a scenario cannot set the parameter scenario')
                if name == 'implementation' and isinstance(value, str):
                    value = resolve_reference(value, self._document.path.parent)
                self._set(parameters, node, name, value, keys)
        if 'changes' in data:
            parameters.set(CONTROLLER, 'changes', self._changes(data['changes'], parameters))
        if self._map_file and is_file_name(parameters.of(PlantParameters).map):
            self._set(parameters, PLANT, 'map', str(self._map_file), ('map',))
        self._check_world(parameters)
        return parameters

    def _radians(self, degrees: float, name: str, keys: Keys) -> float:
        """Convert an angle, or its rate, to radians; an error shows it in degrees, as given."""
        low, high = map(math.degrees, parameters_of(PLANT)[name].bounds or (-math.inf, math.inf))
        if not low <= degrees <= high:
            unit = 'deg/s' if name.startswith('start_pitch_rate') else 'deg'
            limits = f'{low:.1f} … {high:.1f} {unit}'
            raise self._error(keys, f'{self._label(keys)}: {degrees:g} is not within {limits}')
        return math.radians(degrees)

    def _check_world(self, parameters: ParameterSet) -> None:
        """Refuse a map that can't be read, and a start position that is blocked."""
        plant = parameters.of(PlantParameters)
        if not plant.map:
            return
        try:
            floor_map = load_map(plant.map)
        except WorldError as error:
            raise self._error(('map',), str(error)) from None
        try:
            world = World(floor_map, plant.body_depth, plant.body_width)
            world.check_start((plant.start_position_x, plant.start_position_y))
        except WorldError as error:
            raise self._error(('start',), str(error)) from None

    def _map(self, value: object) -> object:
        """Return a shipped map's name unchanged, and resolve a path in the scenario's folder."""
        if isinstance(value, str) and ('/' in value or '.' in value):
            return str((self._document.path.parent / value).resolve())
        return value

    def _signal(self, data: object, keys: Keys, duration: float) -> StickSignal:
        segments = self._each(data, keys, self._segment)
        if fault := segment_fault(segments, duration):
            raise self._error((*keys, fault[0]), fault[1])
        return StickSignal(tuple(segments))

    def _segment(self, data: object, keys: Keys) -> Segment:
        values = self._mapping(data, keys, ('name', 'from', 'to', 'value', 'points'))
        name = values.get('name')
        if not isinstance(name, str) or not name.strip():
            raise self._error(keys, 'a segment needs a name')
        if 'points' in values:
            if 'value' in values or 'from' in values or 'to' in values:
                raise self._error(
                    keys, 'a segment has either points, or from, to and value, not both'
                )
            points = self._each(values['points'], (*keys, 'points'), self._point)
            if len(points) < 2:
                raise self._error((*keys, 'points'), 'a segment needs at least two points')
            for index, ((before, _), (after, _)) in enumerate(pairwise(points), 1):
                if after < before:
                    raise self._error((*keys, 'points', index), f'time goes back to {after:g} s')
            if points[-1][0] <= points[0][0]:
                raise self._error((*keys, 'points'), f'{name!r} has no duration')
            return Segment(name, tuple(points))
        for required in ('from', 'value'):
            if required not in values:
                raise self._error(keys, f'{name!r} needs {required!r}, or points')
        start = self._time(values['from'], (*keys, 'from'))
        end = self._time(values['to'], (*keys, 'to')) if 'to' in values else math.inf
        if end <= start:
            raise self._error((*keys, 'to'), f'time goes back from {start:g} to {end:g} s')
        value = self._stick(values['value'], (*keys, 'value'))
        return Segment.step(name, start, end, value)

    def _point(self, data: object, keys: Keys) -> tuple[float, float]:
        if not isinstance(data, list) or len(data) != 2:
            raise self._error(keys, f'{data!r} is not a pair [time, value]')
        return self._time(data[0], keys), self._stick(data[1], keys)

    def _time(self, value: object, keys: Keys) -> float:
        time = self._number(value, keys)
        if not 0.0 <= time <= TIME_LIMIT:
            raise self._error(keys, f'{time:g} s is not within 0 … {TIME_LIMIT:g} s')
        return time

    def _stick(self, value: object, keys: Keys) -> float:
        number = self._number(value, keys)
        if abs(number) > STICK_LIMIT:
            raise self._error(keys, f'{number:g} is not within -{STICK_LIMIT} … {STICK_LIMIT}')
        return number

    def _pushes(self, data: object, duration: float) -> list[ScheduledPush]:
        pushes = self._each(data, ('pushes',), self.push)
        if fault := push_fault(pushes, duration):
            raise self._error(('pushes', fault[0]), fault[1])
        return pushes

    def push(self, data: object, keys: Keys = ()) -> ScheduledPush:
        """Return a push; ScenarioError if it is not valid."""
        required = ('time', 'duration', 'force', 'direction')
        values = self._mapping(data, keys, (*required, 'torque'))
        are_planes = isinstance(values.get('force'), list)
        for name in required[: 3 if are_planes else 4]:
            if name not in values:
                raise self._error(keys, f'a push needs a {name}')
        time = self._time(values['time'], (*keys, 'time'))
        lasting = self._time(values['duration'], (*keys, 'duration'))
        if lasting == 0.0:
            raise self._error((*keys, 'duration'), 'a push must last longer than 0 s')
        if are_planes:
            if 'direction' in values:
                raise self._error((*keys, 'direction'), 'the forces on two planes have none')
            force = self._both_planes(values['force'], (*keys, 'force'))
            torque = self._both_planes(values.get('torque', [0.0, 0.0]), (*keys, 'torque'))
            return ScheduledPush(time, lasting, force=force, torque=torque)
        if 'torque' in values:
            raise self._error((*keys, 'torque'), 'a torque takes a force [x, y] on both planes')
        size = self._number(values['force'], (*keys, 'force'))
        if not 0.0 <= size <= FORCE_LIMIT:
            raise self._error((*keys, 'force'), f'{size:g} is not within 0 … {FORCE_LIMIT:g} N')
        direction = self._direction(values['direction'], (*keys, 'direction'))
        return ScheduledPush(time, lasting, force=size, direction=direction)

    def _both_planes(self, data: object, keys: Keys) -> tuple[float, float]:
        values = self._each(data, keys, self._number)
        if len(values) != 2 or not all(abs(each) <= FORCE_LIMIT for each in values):
            limits = f'-{FORCE_LIMIT:g} … {FORCE_LIMIT:g}'
            raise self._error(keys, f'{self._label(keys)} is not a pair [x, y] within {limits}')
        return values[0], values[1]

    def _changes(self, data: object, parameters: ParameterSet) -> str:
        changes = self._each(data, ('changes',), self._change)
        for index, each in enumerate(changes):
            if each.time >= parameters.of(PlantParameters).duration:
                raise self._error(('changes', index), 'a change comes after the end of the run')
        return changes_text(changes)

    def _change(self, data: object, keys: Keys) -> TimedChange:
        values = dict(self._mapping(data, keys))
        if 'time' not in values:
            raise self._error(keys, 'a change needs a time')
        time = self._time(values.pop('time'), (*keys, 'time'))
        checked: dict[str, Value] = {}
        for target, value in values.items():
            node, _, name = str(target).partition('.')
            if node != CONTROLLER:
                raise self._error(
                    (*keys, target),
                    f'{target}: only parameters of {CONTROLLER} can change during a run',
                )
            if name == IMPLEMENTATION and isinstance(value, str):
                value = resolve_reference(value, self._document.path.parent)
            checked[name] = checked_change(name, value, f'{self._document.where(*keys, target)}: ')
        if not checked:
            raise self._error(keys, 'a change needs a value, such as controller.k_thetadot: 300')
        return TimedChange(time, checked)

    def _direction(self, value: object, keys: Keys) -> str | float:
        if not isinstance(value, str):
            return self._number(value, keys)
        if value not in PUSH_DIRECTIONS:
            words = ', '.join(PUSH_DIRECTIONS)
            raise self._error(keys, f'{value!r} is neither one of {words} nor a number of degrees')
        return value

    def _set(
        self, parameters: ParameterSet, node: object, name: object, value: object, keys: Keys
    ) -> None:
        parameters.set(str(node), str(name), value, self._document.where(*keys))


def read_push(values: Mapping[str, object], where: str) -> ScheduledPush:
    """Return the push of values as in a scenario; the message of an error begins with `where`."""
    given = SimpleNamespace(where=lambda *keys: where)  # in the place of a file
    return ScenarioReader(cast(YamlDocument, given), load_profile).push(values)


def scenario_names() -> list[str]:
    """Return the names of the shipped scenarios."""
    return shipped_names('scenarios')


def load_scenario(
    name_or_file: str, profile: str | None = None, map_file: Path | None = None
) -> Scenario:
    """Load a shipped scenario by its name, or a file by its path.

    `profile` is a device profile to use instead of the scenario's, and `map_file` an image to read
    instead of any that the scenario names.

    It raises ScenarioError, YamlError or ParameterError: one line with file, line, key, and what is
    allowed.
    """
    document = YamlDocument.named(name_or_file, 'scenarios', 'scenario', ScenarioError)
    return ScenarioReader(document, load_profile, map_file).scenario(profile)


def scenario_of(name_or_file: str) -> Scenario:
    """Load a scenario as :func:`load_scenario` does, or for '' return one without any events."""
    return load_scenario(name_or_file) if name_or_file else Scenario()


def load_profile(name: str) -> ParameterSet:
    """Return the values that the profile `name` sets; ``ideal`` sets none and keeps the defaults.

    A profile of your own is a parameter file, given by its path. It raises ScenarioError, YamlError
    or ParameterError if the profile does not exist, or its file can't be read.
    """
    if name == IDEAL:
        return ParameterSet()
    if is_yaml_path(name):
        return read_parameter_file(name)
    known = [IDEAL, *shipped_names('profiles')]
    if name not in known:
        hint = did_you_mean(name, known)
        raise ScenarioError(
            f'unknown profile {name!r}{hint}; known: {", ".join(known)} '
            '(for your own profile, give the path of its file, ending in .yaml)'
        )
    return read_parameter_file(share_directory() / f'config/profiles/{name}.yaml')
