"""The order of messages from several topics, also if the system clock is set."""

import math

from hypothesis import given
from hypothesis import strategies as st

from ballbot_ros.lockstep.recording_order import ArrivalOrder

SECOND = 1_000_000_000


def test_messages_of_several_topics_come_in_the_order_of_their_times():
    order = ArrivalOrder()
    unmerged = {'a': [(1, 'a1'), (4, 'a4')], 'b': [(2, 'b2'), (3, 'b3')], 'c': []}
    assert order.merge(unmerged, 10) == ['a1', 'b2', 'b3', 'a4']
    assert order.merge({'a': [], 'b': [], 'c': []}, 11) == []


def test_messages_of_one_time_come_in_the_order_of_the_topics():
    order = ArrivalOrder()
    assert order.merge({'a': [(10, 'z')], 'b': [(10, 'y')]}, 10) == ['z', 'y']


def test_messages_that_arrive_during_a_pass_wait_for_the_next():
    order = ArrivalOrder()
    assert order.merge({'a': [(1, 'a1')], 'b': [(12, 'b12'), (15, 'b15')]}, 10) == ['a1']
    assert order.merge({'a': [(11, 'a11')], 'b': [(16, 'b16')]}, 14) == ['a11', 'b12']
    assert order.merge({'a': [], 'b': []}, math.inf) == ['b15', 'b16']


def test_messages_do_not_wait_for_a_clock_that_was_set_back():
    order = ArrivalOrder()
    assert order.merge({'a': [], 'b': [(1001, 'b1')]}, 1000) == []
    unmerged = {'a': [(1002, 'a2'), (3, 'a3')], 'b': [(4, 'b4')]}
    assert order.merge(unmerged, 5) == ['b1', 'b4', 'a2', 'a3']
    assert order.merge({'a': [(6, 'a6')], 'b': []}, 7) == ['a6']


def test_those_that_wait_come_first_and_by_their_times_when_the_clock_is_set_back():
    order = ArrivalOrder()
    assert order.merge({'a': [(1002, 1)], 'b': [(1001, 2)]}, 1000) == []
    assert order.merge({'a': [], 'b': []}, 1000) == [], 'the clock stood still'
    assert order.merge({'a': [], 'b': [(3, 0)]}, 5) == [2, 1, 0]


# Time since the previous event [ns], step of the clock before it, and the event: a message on one
# of three topics, or a look (None).
events = st.lists(
    st.tuples(
        st.integers(0, 5_000_000),
        st.one_of(st.just(0), st.integers(-3600 * SECOND, 3600 * SECOND)),
        st.sampled_from(['a', 'b', 'c', None]),
    )
)


@given(events)
def test_nothing_is_lost_and_each_topic_keeps_its_order(events):
    order = ArrivalOrder()
    clock, come, waiting = 10**18, [], {'a': [], 'b': [], 'c': []}
    sent = []
    for number, (passed, step, topic) in enumerate(events):
        clock += passed + step
        if topic:
            waiting[topic].append((clock, (topic, number)))
            sent.append((topic, number))
        else:
            come += order.merge(waiting, clock)
            waiting = {'a': [], 'b': [], 'c': []}
    come += order.merge(waiting, math.inf)
    for topic in 'abc':
        assert [each for each in come if each[0] == topic] == [s for s in sent if s[0] == topic]


@given(events)
def test_a_clock_that_is_not_set_back_gives_the_order_of_arrival(events):
    order = ArrivalOrder()
    clock, come, waiting, sent = 10**18, [], {'a': [], 'b': [], 'c': []}, []
    for number, (passed, step, topic) in enumerate(events):
        clock += passed + abs(step) + 1
        if topic:
            waiting[topic].append((clock, number))
            sent.append(number)
        else:
            come += order.merge(waiting, clock)
            assert come == sent  # every message that arrived before this look has been handed on
            waiting = {'a': [], 'b': [], 'c': []}
    assert come + order.merge(waiting, math.inf) == sent
