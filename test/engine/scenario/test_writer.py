"""Scenarios as the content of their files."""

import math
from dataclasses import replace

import hypothesis.strategies as st
import pytest
import yaml
from laws import given

from ballbot_ros.engine.scenario.reader import load_scenario, scenario_names
from ballbot_ros.engine.scenario.scenario import (
    PUSH_DIRECTIONS,
    ScheduledPush,
    Segment,
    StickSignal,
)
from ballbot_ros.engine.scenario.writer import scenario_data

HEAD = 'purpose: x\nduration: 100\n'


@pytest.fixture(scope='module')
def read_again(tmp_path_factory):
    folder = tmp_path_factory.mktemp('written')

    def read(scenario):
        path = folder / f'{scenario.name}.yaml'
        path.write_text(yaml.safe_dump(scenario_data(scenario), sort_keys=False), encoding='utf-8')
        return load_scenario(str(path))

    return read


def parts(scenario):
    """Return everything but the text."""
    return (
        scenario.name,
        scenario.purpose,
        scenario.profile,
        list(scenario.parameters),
        *([(each.name, each.points) for each in signal.segments] for signal in sticks(scenario)),
        scenario.pushes,
        scenario.expectations,
        scenario.properties,
    )


def sticks(scenario):
    return scenario.vertical, scenario.horizontal


def test_every_shipped_scenario_is_the_same_when_read_again(read_again):
    for name in scenario_names():
        scenario = load_scenario(name)
        assert parts(read_again(scenario)) == parts(scenario), name
    hardware = load_scenario('push', 'hardware')
    assert parts(read_again(hardware)) == parts(hardware)


NUMBERS = st.floats(0.0, 99.0)
PUSHES = st.builds(
    ScheduledPush,
    NUMBERS,
    st.floats(1e-9, 1e6),
    force=st.floats(0.0, 1000.0),
    direction=st.sampled_from(tuple(PUSH_DIRECTIONS)) | st.floats(-1e9, 1e9),
)


@st.composite
def signals(draw):
    times = sorted(draw(st.lists(NUMBERS, min_size=4, max_size=4, unique=True)))
    a, b, c = (draw(st.floats(-100.0, 100.0)) for _ in 'abc')
    last = times[3] if draw(st.booleans()) else math.inf
    return StickSignal(
        (
            Segment('a "line": #1', ((times[0], a), (times[1], b))),
            Segment.step('step', times[2], last, c),
        )
    )


@given(st.lists(PUSHES, max_size=3).map(tuple), signals(), signals())
def test_pushes_and_sticks_are_the_same_to_the_bit(read_again, pushes, vertical, horizontal):
    plain = load_scenario('stationary')
    scenario = replace(
        plain,
        name='drawn',
        text=HEAD,
        vertical=vertical,
        horizontal=horizontal,
        pushes=pushes,
    )
    again = read_again(scenario)
    assert again.pushes == pushes
    assert [each.points for each in again.vertical.segments] == [
        each.points for each in vertical.segments
    ]
    assert [each.components for each in again.pushes] == [each.components for each in pushes]
    assert parts(again)[4:7] == parts(scenario)[4:7]


def test_paths_are_absolute(tmp_path, read_again):
    (tmp_path / 'mine.py').write_text('')
    path = tmp_path / 'own.yaml'
    path.write_text(HEAD + 'parameters: {controller: {implementation: "mine.py:Mine"}}\n')
    data = scenario_data(load_scenario(str(path)))
    assert data['parameters']['controller']['implementation'] == f'{tmp_path}/mine.py:Mine'
