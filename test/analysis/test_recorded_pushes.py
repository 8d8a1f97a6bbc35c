"""Pushes from outside are told from those of the scenario, and named where a run is judged."""

import json
from dataclasses import replace
from itertools import permutations

import pytest
from hypothesis import strategies as st
from laws import given

from ballbot_ros.analysis import report
from ballbot_ros.analysis.drawing import draw_motion
from ballbot_ros.analysis.recorded_scenario import (
    RecordedPush,
    outside_pushes,
    recorded_pushes,
    scheduled_pushes,
)
from ballbot_ros.engine.scenario.reader import load_scenario
from ballbot_ros.recording.messages.conversions import encode_accepted_push
from ballbot_ros.recording.messages.topics import ACCEPTED_PUSH
from ballbot_ros.robot.plant.ground_truth import Push

START_NS = 1_000_000_000
PUSHES = st.builds(
    Push,
    st.sampled_from((START_NS, 2 * START_NS)),
    st.just(3 * START_NS),
    st.tuples(st.sampled_from((0.0, 1.0)), st.sampled_from((0.0, -1.0))),
)


@given(st.lists(PUSHES, max_size=4), st.lists(PUSHES, max_size=4), st.randoms())
def test_what_the_scenario_does_not_have_came_from_outside(scheduled, others, random):
    acted = scheduled + others
    random.shuffle(acted)
    found = recorded_pushes(acted, scheduled, START_NS)
    assert len(found) == len(acted)
    assert sum(push.is_external for push in found) == len(others)
    assert [push.start for push in found] == sorted(push.start for push in found)


def test_the_pushes_of_a_scenario_are_its_own():
    pushes = scheduled_pushes(load_scenario('push'))
    assert [push.strength for push in pushes] == [
        '1 N forward', '1 N right', '1 N backward left', '0.1 N backward',
    ]  # fmt: skip
    assert not any(push.is_external for push in pushes)
    assert outside_pushes(pushes) == ''


@pytest.mark.parametrize(
    ('force', 'torque', 'words'),
    [
        ((2.0, 0.0), (0.0, 0.0), '2 N forward'),
        ((0.0, -2.0), (0.0, 0.0), '2 N left'),
        ((3.0, 4.0), (0.0, 0.0), '5 N forward right'),
        ((-1.0, 0.0), (0.0, -0.5), '1 N backward, torque x 0, y −0.5 N·m'),
        ((0.0, 0.0), (0.0, 0.0), 'no force'),
    ],
)
def test_force_and_direction_are_in_words(force, torque, words):
    assert RecordedPush(0.0, 1.0, force, torque, is_external=True).strength == words


@pytest.fixture
def pushed(short, copy):
    """A recording of `short` with a push from outside."""
    push = Push(2_500_000_000, 2_600_000_000, (0.0, 2.0))
    name = ACCEPTED_PUSH.resolved()
    messages = [
        (name, stamp, encode_accepted_push(stamp, push, 1, acts=acts))
        for stamp, acts in ((push.start_ns, True), (push.end_ns, False))
    ]
    return copy(short[0], first=messages, types={name: ACCEPTED_PUSH.type_name})


SENTENCE = 'An outside push was part of the run: 2 N right, 1.500 s to 1.600 s.'


def test_report_and_info_say_that_an_outside_push_was_part_of_the_run(
    command, pushed, tmp_path, monkeypatch
):
    monkeypatch.setattr(report, 'draw_figures', lambda run, contents: [])
    for arguments in (('report', pushed, '--output', tmp_path / 'out'), ('info', pushed)):
        status, stdout, _ = command(*arguments)
        assert status == 0
        assert SENTENCE in stdout
    assert SENTENCE in (tmp_path / 'out' / 'index.html').read_text(encoding='utf-8')
    (push,) = json.loads(command('info', pushed, '--json')[1])['external_pushes']
    assert (push['start_s'], push['force_n']) == (1.5, [0.0, 2.0])


def test_a_run_without_one_does_not(command, short, short_document):
    assert 'outside push' not in short_document
    assert 'outside push' not in command('info', short[0])[1]


def test_an_outside_push_is_named_in_the_picture_before_those_of_the_scenario(short_assessment):
    outside = RecordedPush(1.9, 2.0, (1.0, 0.0), (0.0, 0.0), is_external=True)
    scheduled = RecordedPush(2.0, 2.1, (1.0, 0.0), (0.0, 0.0), is_external=False)
    for pushes in permutations((outside, scheduled)):
        marked = replace(short_assessment.run, pushes=pushes).marked
        figure = draw_motion(short_assessment.run.trajectory, '', 1.0, marked=marked[1:])
        names = [text.get_text() for text in figure.axes[0].texts]
        assert names == ['calibration', 'outside push']
