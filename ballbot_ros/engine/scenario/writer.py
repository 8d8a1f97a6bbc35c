"""Scenarios as the content of their files."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import asdict
from typing import Any, cast

from ballbot_ros.engine.scenario.scenario import (
    Expectation,
    Scenario,
    ScheduledPush,
    Segment,
    StickSignal,
)
from ballbot_ros.parameters import CONTROLLER, PLANT, ControllerParameters, PlantParameters
from ballbot_ros.parameters.yaml_document import parse_value
from ballbot_ros.robot.brick.faults import Fault

_EVERY_NODE = '/**'
_OF_THE_GRAPH = ('scenario', 'real_time_factor', 'trajectory_file', 'lockstep')


def scenario_data(scenario: Scenario, plant: PlantParameters | None = None) -> dict[str, Any]:
    """Return the content of a file that describes a scenario.

    Everything but sticks, pushes, faults, expectations and properties is that of the scenario's
    text. The paths of files are absolute, so that the file may be in any folder. Read again, the
    sticks and pushes are the same to the bit.

    The plant is given if that of the run is another than the scenario's. The scenario's duration
    remains if it is the longer one, for pushes that the run does not reach.
    """
    data = cast('dict[str, Any]', parse_value(scenario.text))
    if 'map' in data:
        data['map'] = scenario.parameters.of(PlantParameters).map
    for node, values in data.get('parameters', {}).items():
        if node in (CONTROLLER, _EVERY_NODE) and 'implementation' in values:
            values['implementation'] = scenario.parameters.of(ControllerParameters).implementation
    if plant is not None:
        _set_plant(data, scenario.parameters.of(PlantParameters), plant)
    sticks = {'vertical': scenario.vertical, 'horizontal': scenario.horizontal}
    for key, content in (
        ('sticks', {stick: _signal(each) for stick, each in sticks.items() if each.segments}),
        ('pushes', [_push(each) for each in scenario.pushes]),
        ('faults', [_fault(each) for each in scenario.faults]),
        ('expectations', _expectations(scenario.expectations)),
        ('properties', {each.name: each.text for each in scenario.properties}),
    ):
        data.pop(key, None)
        if content:
            data[key] = content
    return data


def _set_plant(data: dict[str, Any], before: PlantParameters, plant: PlantParameters) -> None:
    """Set the parameters in which the plant of a run differs from the scenario's."""
    old = before.values()
    new = {**plant.values(), 'duration': max(before.duration, plant.duration)}
    changed = [name for name in new if new[name] != old[name] and name not in _OF_THE_GRAPH]
    if not changed:
        return
    data['duration'] = new['duration']
    nodes = dict(data.get('parameters', {}))
    # The last node prevails, also over the scenario's other keys.
    names = dict.fromkeys((*nodes.pop(PLANT, {}), *changed))
    data['parameters'] = {**nodes, PLANT: {name: new[name] for name in names}}


def _signal(signal: StickSignal) -> list[dict[str, object]]:
    return [_segment(each) for each in signal.segments]


def _segment(segment: Segment) -> dict[str, object]:
    if not segment.is_step:
        return {'name': segment.name, 'points': [list(point) for point in segment.points]}
    end = {} if segment.end == math.inf else {'to': segment.end}
    return {'name': segment.name, 'from': segment.start, **end, 'value': segment.points[0][1]}


def _push(push: ScheduledPush) -> dict[str, object]:
    content: dict[str, object] = {'time': push.time, 'duration': push.duration}
    if isinstance(push.force, tuple):
        return {**content, 'force': list(push.force), 'torque': list(push.torque)}
    return {**content, 'force': push.force, 'direction': push.direction}


def _fault(fault: Fault) -> dict[str, object]:
    return {name: value for name, value in asdict(fault).items() if value is not None}


def _expectations(expectations: Iterable[Expectation]) -> dict[str, list[dict[str, float]]]:
    content: dict[str, list[dict[str, float]]] = {}
    for each in expectations:
        bounds = {'min': each.minimum, 'max': each.maximum}
        window = {} if each.start == 0.0 else {'from': each.start}
        window |= {} if each.end == math.inf else {'to': each.end}
        given = {key: value for key, value in bounds.items() if value is not None}
        content.setdefault(each.metric, []).append({**given, **window})
    return content
