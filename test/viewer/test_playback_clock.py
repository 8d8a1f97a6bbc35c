"""The time of a playback: rates, keys, loop, and the transport bar that shows them."""

import pytest

from ballbot_ros.recording.playback import KEYS, RATES, SKIP_S, PlaybackAction, PlaybackClock
from ballbot_ros.viewer.overlay import ChooseRate, Hold, Mark, MarkKind, Press, Seek, Timeline
from ballbot_ros.viewer.recording_page import playback_overlay, take_request

END = 20.0
TIMELINE = Timeline(END, (Mark(1.0, MarkKind.PUSH, 'push'),))


def clock(time=0.0, *, is_playing=True, is_looping=False, rate=1.0):
    made = PlaybackClock(END)
    made.time, made.is_playing, made.is_looping, made.rate = time, is_playing, is_looping, rate
    return made


def state(made):
    return made.time, made.is_playing


def test_the_clock_stops_at_the_end_and_begins_again():
    made = clock(rate=0.5)
    assert made.advance(1.0) == (0.0, 0.5)
    made.apply(PlaybackAction.PAUSE)
    assert made.advance(1.0) == (0.5, 0.5)
    made.apply(PlaybackAction.PAUSE)
    assert made.advance(100.0) == (0.5, END)
    assert state(made) == (END, False)
    made.apply(PlaybackAction.PAUSE)
    assert state(made) == (0.0, True)


def test_a_loop_shows_the_end_and_restarts():
    made = clock(END - 0.5, is_looping=True)
    assert made.advance(1.0) == (END - 0.5, END)
    assert made.advance(1.0) == (0.0, 1.0)
    made.apply(PlaybackAction.LOOP)
    made.advance(100.0)
    assert state(made) == (END, False)


@pytest.mark.parametrize(
    ('action', 'before', 'after'),
    [
        (PlaybackAction.PAUSE, (3.0, True), (3.0, False)),
        (PlaybackAction.PAUSE, (3.0, False), (3.0, True)),
        (PlaybackAction.STEP, (3.0, True), (3.004, False)),
        (PlaybackAction.STEP, (END, False), (END, False)),
        (PlaybackAction.BACK, (8.0, True), (8.0 - SKIP_S, True)),
        (PlaybackAction.BACK, (1.0, False), (0.0, False)),
        (PlaybackAction.FORWARD, (3.0, True), (3.0 + SKIP_S, True)),
        (PlaybackAction.FORWARD, (END - 1.0, True), (END, True)),
        (PlaybackAction.START, (3.0, True), (0.0, True)),
        (PlaybackAction.START, (3.0, False), (0.0, False)),
        (PlaybackAction.END, (3.0, True), (END, False)),
    ],
)
def test_a_key_moves_or_stops_the_clock(action, before, after):
    made = clock(before[0], is_playing=before[1])
    made.apply(action)
    assert state(made) == pytest.approx(after)


def test_keys_choose_the_next_rate_up_to_the_last():
    made = clock()
    for action, limit in ((PlaybackAction.FASTER, RATES[-1]), (PlaybackAction.SLOWER, RATES[0])):
        seen = []
        for _ in RATES:
            made.apply(action)
            seen.append(made.rate)
        assert set(seen) <= set(RATES)
        assert seen[-1] == limit
    assert len(set(seen)) == len(RATES) - 1


def test_pages_can_ask_for_what_is_offered_and_nothing_else():
    made = clock()
    for request, expected in (
        (ChooseRate('0.25×'), (0.0, True, 0.25)),
        (ChooseRate('1000×'), (0.0, True, 0.25)),
        (Seek(4.0), (4.0, True, 0.25)),
        (Seek(1e9), (END, True, 0.25)),
        (Seek(-1.0), (0.0, True, 0.25)),
        (Press('pause'), (0.0, False, 0.25)),
        (Press('__class__'), (0.0, False, 0.25)),
        (Press('faster'), (0.0, False, 0.5)),
        (Hold(1, 1.0, 0.0, 0.0), (0.0, False, 0.5)),
    ):
        take_request(made, request)
        assert (*state(made), made.rate) == expected, request


def test_the_transport_bar_shows_the_clock():
    shown = playback_overlay(clock(rate=0.25, is_looping=True), TIMELINE)
    assert shown.rate in shown.rates
    assert shown.timeline == TIMELINE
    assert not shown.can_drive
    assert [button.label for button in shown.buttons if button.is_pressed] == ['Loop']
    assert 'Pause' in {button.label for button in shown.buttons}
    paused = playback_overlay(clock(is_playing=False), TIMELINE)
    assert 'Play' in {button.label for button in paused.buttons}
    assert all(button.tip for button in paused.buttons)


def test_every_action_has_one_key_of_its_own():
    assert [key.action for key in KEYS] == list(PlaybackAction)
    assert len({key.browser for key in KEYS}) == len(KEYS)
    terminal = [each for key in KEYS for each in key.terminal]
    assert len(set(terminal)) == len(terminal)
