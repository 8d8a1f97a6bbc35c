"""Pushes, sticks and faults that vary from run to run of a study."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from ballbot_ros.engine.rows import Column
from ballbot_ros.engine.scenario.reader import STICK_LIMIT, TIME_LIMIT
from ballbot_ros.engine.scenario.scenario import (
    PUSH_DIRECTIONS,
    Scenario,
    Segment,
    StickSignal,
    segment_fault,
)
from ballbot_ros.errors import StudyError
from ballbot_ros.parameters import Parameter, ParameterError
from ballbot_ros.robot.brick.faults import KINDS, WORDS, Fault, fault_texts
from ballbot_ros.robot.plant.ground_truth import FORCE_LIMIT

PUSH, STICK, FAULT = 'push', 'stick', 'fault'
STICKS = ('vertical', 'horizontal')

_TIMES = (0.0, TIME_LIMIT)
_STICK = (-float(STICK_LIMIT), float(STICK_LIMIT))


def _fields(**known: tuple[str, tuple[float, float] | None]) -> Mapping[str, Parameter]:
    return {
        name: Parameter((), name, 0.0, '', unit=unit, bounds=bounds)
        for name, (unit, bounds) in known.items()
    }


_PUSH_FIELDS = _fields(
    force=('N', (0.0, FORCE_LIMIT)), direction=('deg', None), time=('s', _TIMES),
    duration=('s', _TIMES),
)  # fmt: skip
_SEGMENT_FIELDS = _fields(**{'value': ('%', _STICK), 'from': ('s', _TIMES), 'to': ('s', _TIMES)})
_KIND = Parameter((), 'kind', KINDS[0], '', choices=KINDS)

_BEGINNINGS = ('time', 'from')
_ENDS = ('to',)


@dataclass(frozen=True)
class EventPart:
    """A value of a push, of a fault or of a segment of a stick.

    Attributes
    ----------
    owner : str
        ``push``, ``fault``, or the name of the stick.
    index : int
        Which of them, from 0.
    parameter : Parameter
        Its name in them, and what it may be.
    """

    owner: str
    index: int
    parameter: Parameter

    @property
    def field(self) -> str:
        """Its name in the push, fault or segment."""
        return self.parameter.name


def is_event(name: str) -> bool:
    """Return whether a variable's name is that of a push, a stick or a fault."""
    return name.partition('.')[0] in (PUSH, STICK, FAULT)


def event_part(name: str, scenario: Scenario) -> EventPart:
    """Return the part of a scenario's pushes and sticks that a variable names.

    It raises StudyError if the scenario has none of this name; the message is one line without a
    place.
    """
    kind, _, rest = name.partition('.')
    if kind == STICK:
        return _segment_part(name, scenario)
    number, _, field = rest.partition('.')
    several, events = ('pushes', scenario.pushes) if kind == PUSH else ('faults', scenario.faults)
    numbers = [str(each) for each in range(1, len(events) + 1)]
    if number not in numbers:
        known = f'its {several} are 1 … {len(numbers)}' if numbers else f'it has no {several}'
        raise StudyError(f'{name}: the scenario has no {kind} {number!r}; {known}')
    index = int(number) - 1
    if kind == PUSH:
        part = EventPart(kind, index, _field(name, field, _PUSH_FIELDS, f'{kind}.{number}'))
        if isinstance(scenario.pushes[index].force, tuple) and field in ('force', 'direction'):
            raise StudyError(f'{name}: that push has forces on both planes, without a direction')
        return part
    rows = {**scenario.faults[index].rows, _KIND.name: _KIND}
    return EventPart(kind, index, _field(name, field, rows, f'{kind}.{number}'))


def _segment_part(name: str, scenario: Scenario) -> EventPart:
    _, _, rest = name.partition('.')
    stick, _, rest = rest.partition('.')
    segment_name, _, field = rest.rpartition('.')
    if stick not in STICKS:
        raise StudyError(f'{name}: {stick!r} is not one of {", ".join(STICKS)}')
    segments = getattr(scenario, stick).segments
    names = [each.name for each in segments]
    if segment_name not in names:
        known = f'it has {", ".join(dict.fromkeys(names))}' if names else 'it has none'
        raise StudyError(
            f'{name}: the scenario has no segment {segment_name!r} on the {stick} stick; {known}'
        )
    if names.count(segment_name) > 1:
        raise StudyError(
            f'{name}: {names.count(segment_name)} segments of the {stick} stick are called '
            f'{segment_name!r}; give each a name of its own in the scenario'
        )
    parameter = _field(name, field, _SEGMENT_FIELDS, f'{STICK}.{stick}.{segment_name}')
    index = names.index(segment_name)
    if not segments[index].is_step:
        raise StudyError(f'{name}: the segment has points; only from, to and value can vary')
    return EventPart(stick, index, parameter)


def value_in(scenario: Scenario, part: EventPart) -> Any:
    """Return the value of a part in a scenario; None if a fault has none of its own."""
    if part.owner in STICKS:
        segment = getattr(scenario, part.owner).segments[part.index]
        values = {'value': segment.points[0][1], 'from': segment.start, 'to': segment.end}
        return values[part.field]
    if part.owner == PUSH:
        value = asdict(scenario.pushes[part.index])[part.field]
        if isinstance(value, str):
            forward, right = PUSH_DIRECTIONS[value]
            return math.degrees(math.atan2(-right, forward)) % 360.0
        return value
    fault = scenario.faults[part.index]
    if part.field == _KIND.name:
        return f'{fault.component} {fault.type}'
    return asdict(fault)[part.field]


def _field(name: str, field: str, known: Mapping[str, Parameter], owner: str) -> Parameter:
    if field not in known:
        raise StudyError(f'{name}: {owner} has no {field!r}; it has {", ".join(known)}')
    return known[field]


def scenarios_of(
    scenario: Scenario,
    columns: Mapping[str, Column],
    durations: NDArray[np.float64],
    first: int = 0,
) -> list[Scenario]:
    """Return the scenarios of runs whose pushes and sticks have their own values.

    It raises StudyError if a run's pushes or sticks are not possible; the message names the run.

    Parameters
    ----------
    columns : mapping of str to ndarray
        The values of what varies, each (r,).
    durations : ndarray, shape (r,)
        Lengths of the runs [s].
    first : int
        Number of the first run, for error messages.
    """
    parts = [event_part(name, scenario) for name in columns]
    table = zip(*(values.tolist() for values in columns.values()), strict=True)
    return [
        _scenario(
            scenario,
            tuple(zip(parts, values, strict=True)),
            duration,
            f'run {first + run}',
        )
        for run, (values, duration) in enumerate(zip(table, durations.tolist(), strict=True))
    ]


def extreme_scenarios(
    scenario: Scenario, ends: Sequence[tuple[EventPart, tuple[Any, Any]]], duration: float
) -> list[Scenario]:
    """Return scenarios with the extreme values; StudyError if one is not possible.

    `ends` has the smallest and the largest value of each part that varies; `duration` is that of
    the shortest run [s].
    """
    # Late beginnings and early ends, then the opposite.
    return [
        _scenario(
            scenario,
            [(part, high if part.field in late else low) for part, (low, high) in ends],
            duration,
            f'with the {what}',
        )
        for late, what in ((_BEGINNINGS, 'latest beginnings'), (_ENDS, 'latest ends'))
    ]


def _scenario(
    scenario: Scenario, values: Sequence[tuple[EventPart, Any]], duration: float, which: str
) -> Scenario:
    pushes = list(scenario.pushes)
    sticks = {stick: list(getattr(scenario, stick).segments) for stick in STICKS}
    faults = [asdict(each) for each in scenario.faults]
    for part, value in values:
        if part.owner == FAULT:
            fields = WORDS if part.field == _KIND.name else (part.field,)
            words = value.split() if len(fields) > 1 else (value,)
            faults[part.index] |= zip(fields, words, strict=True)
        elif part.owner == PUSH:
            pushes[part.index] = replace(pushes[part.index], **cast(Any, {part.field: value}))
            if pushes[part.index].duration <= 0.0:
                raise StudyError(f'{PUSH}.{part.index + 1}: must last longer than 0 s ({which})')
        else:
            segments = sticks[part.owner]
            segments[part.index] = _with_field(segments[part.index], part.field, value)
    times = {PUSH: [each.time for each in pushes], FAULT: [each['time'] for each in faults]}
    # Others may begin after the end: a run may be shorter than the scenario's.
    for part, _ in values:
        if part.owner in STICKS:
            _check_segment(part, sticks[part.owner], duration, which)
        elif times[part.owner][part.index] >= duration:
            label = f'{part.owner}.{part.index + 1}: a {part.owner}'
            raise StudyError(f'{label} begins after the end of the run ({which})')
    vertical, horizontal = (StickSignal(tuple(sticks[stick])) for stick in STICKS)
    try:
        failing = tuple(Fault(**each) for each in faults)
    except ParameterError as error:
        raise StudyError(f'{error} ({which})') from None
    return replace(
        scenario, pushes=tuple(pushes), vertical=vertical, horizontal=horizontal, faults=failing
    )


def fault_values(scenario: Scenario, given: Scenario) -> dict[str, object]:
    """Return the parameters ``faults`` of a run whose scenario has other ones than the given."""
    if scenario.faults == given.faults:
        return {}
    return {f'{node}.faults': text for node, text in fault_texts(scenario.faults).items()}


def _with_field(segment: Segment, field: str, value: float) -> Segment:
    parts = {'from': segment.start, 'to': segment.end, 'value': segment.points[0][1], field: value}
    return Segment.step(segment.name, parts['from'], parts['to'], parts['value'])


def _check_segment(
    part: EventPart, segments: Sequence[Segment], duration: float, which: str
) -> None:
    changed = segments[part.index]
    if changed.end <= changed.start:
        raise StudyError(
            f'{STICK}.{part.owner}.{changed.name}: time goes back from {changed.start:g} to '
            f'{changed.end:g} s ({which})'
        )
    if fault := segment_fault([changed], duration) or segment_fault(segments, math.inf):
        raise StudyError(f'{STICK}.{part.owner}: {fault[1]} ({which})')
