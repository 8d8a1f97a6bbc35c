"""The permitted lead of the plant over the recorder: tables of ticks."""

import pytest

from ballbot_ros.lockstep.participants import Participant
from ballbot_ros.lockstep.recording_order import RecorderFlow
from ballbot_ros.parameters import RECORDER
from ballbot_ros.parameters.timing import MAX_LEAD_TICKS, TICK_NS

START_NS = 1_000_000_000
FIRST, SECOND = (
    Participant(RECORDER, f'/{RECORDER}', 'here', number, str(number), 'ours', '00')
    for number in (1, 2)
)


def tick(number):
    return START_NS + number * TICK_NS


def flow(*acked, recorder=FIRST):
    result = RecorderFlow(START_NS)
    result.begin(recorder)
    for number in acked:
        result.ack_ns = tick(number)
    return result


@pytest.mark.parametrize(
    ('acked', 'now', 'lags'),
    [
        # Nothing before the first tick is recorded.
        (None, 0, True),
        (0, 0, False),
        (0, MAX_LEAD_TICKS, False),
        (0, MAX_LEAD_TICKS + 1, True),
        (7, MAX_LEAD_TICKS + 7, False),
        (7, MAX_LEAD_TICKS + 8, True),
    ],
)
def test_the_plant_waits_for_the_first_tick_and_at_its_greatest_lead(acked, now, lags):
    one = flow() if acked is None else flow(acked)
    assert one.lags(tick(now)) is lags


def test_without_a_recorder_the_plant_does_not_wait():
    one = flow(recorder=None)
    assert not one.lags(tick(1000))
    assert one.has_all(tick(1000))
    assert one.next_ns is None


@pytest.mark.parametrize(('now', 'first'), [(0, 0), (1, 5), (5, 5), (6, 10)])
def test_a_joining_recorder_begins_at_a_multiple_of_20_ms(now, first):
    one = flow(recorder=None)
    assert one.join(FIRST, tick(now))
    assert not one.join(FIRST, tick(now))
    assert not one.lags(tick(first - 1))
    assert one.lags(tick(first))
    one.ack_ns = tick(first)
    assert not one.lags(tick(first))


def test_another_recorder_takes_over():
    one = flow(100)
    assert one.join(SECOND, tick(101))
    assert one.recorder is SECOND
    assert one.next_ns is None
    assert one.lags(tick(105))


def test_a_recorder_that_has_left_returns_only_as_another():
    one = flow(100)
    one.leave()
    assert not one.join(FIRST, tick(101))
    assert one.recorder is None
    assert one.join(SECOND, tick(101))


def test_repeated_ticks_must_be_recorded_before_the_run_continues():
    one = flow(5)
    one.require_ack(tick(10))
    assert one.lags(tick(10))
    one.ack_ns = tick(10)
    assert not one.lags(tick(11))


@pytest.mark.parametrize(
    ('acked', 'last', 'has_all'), [(None, 0, False), (4, 5, False), (5, 5, True)]
)
def test_a_run_ends_with_its_last_tick_recorded(acked, last, has_all):
    one = flow() if acked is None else flow(acked)
    assert one.has_all(tick(last)) is has_all
    assert one.next_ns == (None if acked is None else tick(acked + 1))


def test_a_recorder_whose_first_tick_is_after_the_last_has_everything():
    one = flow(recorder=None)
    one.join(FIRST, tick(6))
    assert one.has_all(tick(9))
    assert not one.has_all(tick(10))
