"""Detection of complete ticks: tables of streams, and samples in every order."""

import itertools

import pytest

from ballbot_ros.lockstep.recording_order import RecordedTicks, Stream
from ballbot_ros.parameters.timing import SLOW_PERIOD_NS, TICK_NS

START_NS = 1_000_000_000


def tick(number):
    return START_NS + number * TICK_NS


class Recorded:
    """Two fast streams and a slow one that a run requires."""

    def __init__(self):
        self.streams = {
            'gyro': Stream('gyro', period_ns=TICK_NS, is_same=bytes.__eq__),
            'duty': Stream('duty', period_ns=TICK_NS, is_same=bytes.__eq__),
            'sonar': Stream('sonar', period_ns=SLOW_PERIOD_NS, is_same=bytes.__eq__),
        }
        self.ticks = RecordedTicks()
        self.ticks.require(self.streams.values())

    def take(self, name, number):
        self.streams[name].classify(tick(number), b'', number)
        return self.ticks.advance()


def test_a_tick_is_complete_when_the_last_stream_has_it_in_any_order():
    for order in itertools.permutations(('gyro', 'duty', 'sonar')):
        recorded = Recorded()
        assert [recorded.take(name, 0) for name in order] == [False, False, True]
        assert recorded.ticks.acked_ns == tick(0)


@pytest.mark.parametrize(
    ('gyro', 'duty', 'sonar', 'acked'),
    [
        # A slow stream lacks nothing until its next multiple of 20 ms.
        (4, 4, 0, 4),
        (5, 5, 0, 4),
        (5, 5, 5, 5),
        (5, 3, 5, 3),
        (3, 9, 5, 3),
        (20, 20, 15, 19),
    ],
)
def test_the_stream_that_is_furthest_behind_counts(gyro, duty, sonar, acked):
    recorded = Recorded()
    for name, number in (('gyro', gyro), ('duty', duty), ('sonar', sonar)):
        recorded.take(name, number)
    assert recorded.ticks.acked_ns == tick(acked)


def test_nothing_is_complete_before_the_requirements_are_known():
    recorded = Recorded()
    recorded.ticks.begin()
    assert not recorded.take('gyro', 0)
    recorded.ticks.require([recorded.streams['gyro']])
    assert recorded.ticks.advance()
    assert not recorded.ticks.advance()


def test_each_complete_tick_is_reported_once_and_stays_complete():
    recorded = Recorded()
    for name in recorded.streams:
        recorded.take(name, 5)
    recorded.streams['new'] = Stream('new', period_ns=TICK_NS, is_same=bytes.__eq__)
    recorded.ticks.require(recorded.streams.values())
    assert not recorded.take('new', 3)
    assert recorded.ticks.acked_ns == tick(5)
    recorded.ticks.begin()
    assert recorded.ticks.acked_ns == 0
