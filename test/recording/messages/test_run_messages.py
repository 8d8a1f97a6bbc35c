"""The messages of a run without a graph: their order, and messages sent only at changes."""

from collections import defaultdict

import pytest

from ballbot_ros.engine.closed_loop import ClosedLoop
from ballbot_ros.parameters import ParameterSet
from ballbot_ros.parameters.timing import TICK_NS
from ballbot_ros.recording.messages.run_messages import RunMessages
from ballbot_ros.recording.messages.topics import (
    ACCEPTED_PUSH,
    CLOCK,
    CONTROLLER_STATE,
    MOTOR_DUTY,
    OPERATING_STATE,
    RUN,
    TOPICS,
    WALL_HIT,
)
from ballbot_ros.robot.plant.ground_truth import Push

TICKS = 150


@pytest.fixture(scope='module')
def loop():
    return ClosedLoop(ParameterSet())


@pytest.fixture(scope='module')
def sent(loop):
    """Return the topics by stamp, in the order of their messages."""
    found = defaultdict(list)
    messages = RunMessages(
        lambda topic: lambda stamp, data: found[stamp].append(topic), ParameterSet()
    )
    start = loop.plant.time_ns
    messages.begin(start, None, [Push(start + 1, start + 2, (1.0, 0.0), (0.0, 0.0))])
    assert [found.pop(start), found.pop(start + 1), found.pop(start + 2)] == [
        [RUN, WALL_HIT],
        [ACCEPTED_PUSH],
        [ACCEPTED_PUSH],
    ]
    for _ in range(TICKS):
        messages.tick(loop.tick(), loop.program)
    messages.plant.truth(loop.plant.truth(), wall_hit=True)
    return dict(found)


def test_each_periodic_topic_has_a_message_at_every_multiple_of_its_period(sent):
    ticks = sorted(sent)[:-1]
    assert len(ticks) == TICKS
    for stamp in ticks:
        due = {t for t in TOPICS if t.period_ns and stamp % t.period_ns == 0}
        assert {t for t in sent[stamp] if t.period_ns} == due
        assert len(set(sent[stamp])) == len(sent[stamp])


def test_the_messages_of_a_tick_go_from_the_clock_to_the_duty_after_the_events(sent):
    stamps = sorted(sent)[:-1]
    for stamp in stamps:
        assert sent[stamp][0] is CLOCK
        assert sent[stamp][-2:] == [MOTOR_DUTY, CONTROLLER_STATE]
    assert stamps[-1] - stamps[0] == (TICKS - 1) * TICK_NS


def test_states_and_hits_are_sent_when_they_change(sent):
    changes = [stamp for stamp in sent if OPERATING_STATE in sent[stamp]]
    assert changes[0] == min(sent)
    assert len(changes) < 5
    assert [stamp for stamp in sent if WALL_HIT in sent[stamp]] == [max(sent)]
