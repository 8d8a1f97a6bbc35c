"""The source in command, and the pause of half a second between sources."""

import pytest
from hypothesis import strategies as st
from laws import given

from ballbot_ros.nodes.teleop.sticks import (
    LIVE_SOURCES,
    NO_SOURCE,
    SILENCE_S,
    TAKEOVER_DELAY_S,
    Arbiter,
    Command,
)
from ballbot_ros.recording.messages.topics import SCENARIO
from ballbot_ros.robot.brick.bluetooth import NEUTRAL

DEVICE, JOY, VIEWER, KEYBOARD, CMD_VEL = LIVE_SOURCES
RANK = {source: rank for rank, source in enumerate((*LIVE_SOURCES, SCENARIO))}
PLAYED = (7, -7)

sticks = st.tuples(st.integers(-100, 100), st.integers(-100, 100)) | st.just(NEUTRAL)
reports = st.tuples(st.just('report'), st.sampled_from(LIVE_SOURCES), sticks)
releases = st.tuples(st.just('release'), st.sampled_from(LIVE_SOURCES), st.just(NEUTRAL))
steps = st.lists(st.tuples(st.sampled_from([0.0, 0.02, 0.1, 0.3, 0.6]), reports | releases))


def play(events):
    """Yield time, decision, and the newest report of each source, after each event."""
    arbiter, newest, now = Arbiter(), {}, 100.0
    for wait, (kind, source, value) in events:
        now += wait
        if kind == 'report':
            arbiter.report(source, value, now)
            newest[source] = (value, now)
        else:
            arbiter.release(source)
            newest.pop(source, None)
        yield now, arbiter.select(now, PLAYED), dict(newest)


def drives(source, newest, now):
    value, at = newest.get(source, (NEUTRAL, now))
    return value != NEUTRAL and now - at <= SILENCE_S


@given(steps)
def test_the_sticks_are_those_of_a_live_source_or_neutral(events):
    for now, command, newest in play(events):
        if command.source == SCENARIO:
            assert command.sticks == PLAYED
            assert not any(drives(source, newest, now) for source in LIVE_SOURCES)
        elif command.sticks != NEUTRAL:
            assert drives(command.source, newest, now)
            assert command.sticks == newest[command.source][0]


@given(steps)
def test_a_source_of_higher_priority_never_waits(events):
    for now, command, newest in play(events):
        higher = LIVE_SOURCES[: RANK[command.source]]
        assert not any(drives(source, newest, now) for source in higher)


@given(steps)
def test_the_sticks_are_neutral_before_a_source_of_lower_priority_takes_over(events):
    before, last_driven = Command(SCENARIO, PLAYED), None
    for now, command, _ in play(events):
        if RANK[command.source] > RANK[before.source]:
            assert before.sticks == NEUTRAL
            assert last_driven is None or now - last_driven >= TAKEOVER_DELAY_S
        if command.sticks != NEUTRAL:
            last_driven = now
        before = command


@given(st.lists(sticks, min_size=1))
def test_without_a_live_input_the_scenario_acts_as_it_is(signals):
    arbiter = Arbiter()
    for number, signal in enumerate(signals):
        assert arbiter.select(number * 0.02, signal) == (SCENARIO, signal)


def test_a_silent_source_is_neutral_at_once_and_replaced_after_the_pause():
    arbiter = Arbiter()
    arbiter.report(JOY, (-50, 0), 0.0)
    assert arbiter.select(0.5, PLAYED) == (JOY, (-50, 0))
    assert arbiter.select(0.51, PLAYED) == (JOY, NEUTRAL)
    assert arbiter.select(1.0, PLAYED) == (JOY, NEUTRAL)
    assert arbiter.select(1.02, PLAYED) == (SCENARIO, PLAYED)


def test_a_source_that_passes_through_neutral_stays_in_command():
    arbiter = Arbiter()
    arbiter.report(CMD_VEL, (9, 9), 0.0)
    for now, value in ((0.0, (-50, 0)), (0.02, NEUTRAL), (0.04, (50, 0))):
        arbiter.report(JOY, value, now)
        assert arbiter.select(now, PLAYED) == (JOY, value)


def test_a_source_of_higher_priority_takes_over_at_once_even_in_the_pause():
    arbiter = Arbiter()
    arbiter.report(CMD_VEL, (9, 9), 0.0)
    assert arbiter.select(0.0, PLAYED) == (CMD_VEL, (9, 9))
    arbiter.release(CMD_VEL)
    assert arbiter.select(0.1, PLAYED) == (CMD_VEL, NEUTRAL)
    arbiter.report(KEYBOARD, (1, 0), 0.2)
    assert arbiter.select(0.2, PLAYED) == (KEYBOARD, (1, 0))
    arbiter.report(DEVICE, (2, 0), 0.3)
    assert arbiter.select(0.3, PLAYED) == (DEVICE, (2, 0))


@pytest.mark.parametrize('source', LIVE_SOURCES)
def test_a_neutral_source_does_not_keep_the_scenario_from_acting(source):
    arbiter = Arbiter()
    arbiter.report(source, NEUTRAL, 0.0)
    assert arbiter.select(0.0, PLAYED) == (SCENARIO, PLAYED)


def test_without_a_scenario_nobody_is_in_command():
    assert Command(SCENARIO, NEUTRAL).source_name('') == NO_SOURCE
    assert Command(SCENARIO, PLAYED).source_name('stationary') == SCENARIO
    assert (
        Command(JOY, NEUTRAL).source_name('')
        == Command(JOY, NEUTRAL).source_name('stationary')
        == JOY
    )
