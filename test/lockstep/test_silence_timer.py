"""The part of a silence that counts on a busy machine."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ballbot_ros.lockstep.liveness import SilenceTimer, ThreadTime

WAITING = ThreadTime(cpu_s=1.0, queued_s=0.0, is_runnable=False)
IDLE = {1: WAITING}


def timer_after(*looks):
    """Return a timer after updates, each a time and the processes; the silence began at 0 s."""
    timer = SilenceTimer()
    for now_s, processes in looks:
        timer.update(0.0, now_s, processes)
    return timer


@pytest.mark.parametrize(
    ('name', 'progress', 'counts'),
    [
        ('waits for a message, or is stopped', lambda now: WAITING, 1.0),
        ('computes without an end', lambda now: ThreadTime(now, 0.0, is_runnable=True), 1.0),
        ('so with a tenth of a processor', lambda now: ThreadTime(0.1 * now, now, True), 0.1),
        ('works now and then', lambda now: ThreadTime(0.1 * now, 0.4 * now, False), 0.6),
        ('waits for its turn', lambda now: ThreadTime(1.0, 0.0, is_runnable=True), 0.0),
    ],
)
def test_only_the_time_given_by_the_machine_counts(name, progress, counts):
    timer = timer_after(*((0.1 * look, {7: {1: progress(0.1 * look)}}) for look in range(101)))
    assert timer.silence_s(7) == pytest.approx(10.0 * counts, abs=0.11)


def test_threads_that_wait_do_not_hide_one_that_hangs():
    def process(look):
        others = {each: ThreadTime(0.0, 0.02 * look, is_runnable=False) for each in range(2, 7)}
        return {1: WAITING, **others}

    timer = timer_after(*((0.1 * look, {7: process(look)}) for look in range(101)))
    assert timer.silence_s(7) == pytest.approx(8.0, abs=0.11)


def test_a_new_thread_holds_up_nothing():
    new = {**IDLE, 2: ThreadTime(0.0, 5.0, is_runnable=False)}
    assert timer_after((0.1, {7: IDLE}), (0.2, {7: new})).silence_s(7) == pytest.approx(0.2)


def test_each_process_has_its_own_silence():
    def processes(look):
        return {1: IDLE, 2: {1: ThreadTime(0.0, 0.05 * look, is_runnable=False)}}

    timer = timer_after(*((0.1 * look, processes(look)) for look in range(101)))
    assert timer.silence_s(1) == pytest.approx(10.0)
    assert timer.silence_s(2) == pytest.approx(5.0, abs=0.11)
    assert timer.silence_s() == pytest.approx(10.0), 'that of another machine'


def test_a_process_that_has_ended_has_had_the_time():
    timer = timer_after((0.1, {1: IDLE}), (0.2, {}), (0.3, {}))
    assert timer.silence_s(1) == pytest.approx(0.3)
    assert timer.silence_s(2) == pytest.approx(0.3), 'gone before the first look'


def test_only_the_time_since_its_start_counts_for_a_new_process():
    timer = timer_after((0.1, {1: IDLE}), (0.2, {1: IDLE, 2: IDLE}), (0.3, {1: IDLE, 2: IDLE}))
    assert timer.silence_s(2) == pytest.approx(0.2)


def test_a_process_all_of_whose_threads_are_new_has_had_the_time():
    other = {2: ThreadTime(9.0, 5.0, is_runnable=True)}
    assert timer_after((0.1, {7: IDLE}), (0.2, {7: other})).silence_s(7) == pytest.approx(0.2)


def test_time_without_updates_does_not_count():
    assert timer_after((0.1, {}), (100.0, {})).silence_s() == pytest.approx(0.3)


def test_a_process_that_computes_is_not_spared_by_an_observer_that_is_starved():
    """It has a quarter of a processor; who measures its silence is let run once in 0.8 s."""

    def process(now):
        return {1: ThreadTime(0.25 * now, 0.75 * now, is_runnable=True)}

    timer = timer_after(*((0.8 * look, {7: process(0.8 * look)}) for look in range(101)))
    assert timer.silence_s(7) == pytest.approx(20.0, abs=0.2)
    sleeps = timer_after(*((0.8 * look, {7: IDLE}) for look in range(101)))
    assert sleeps.silence_s(7) == pytest.approx(20.0, abs=0.2), 'its answer may be on the way'
    once = timer_after((0.0, {7: process(0.0)}), (100.0, {7: process(100.0)}))
    assert once.silence_s(7) == pytest.approx(1.0), 'not enough to end a run'


def test_another_silence_begins_at_zero():
    timer = timer_after(*((0.1 * look, {1: IDLE}) for look in range(31)))
    timer.update(2.9, 3.0, {1: IDLE})
    assert timer.silence_s(1) == timer.silence_s() == pytest.approx(0.1)


@given(
    st.lists(
        st.tuples(st.floats(0.0, 2.0), st.floats(0.0, 1.0), st.floats(0.0, 3.0), st.booleans()),
        min_size=1,
        max_size=30,
    )
)
def test_a_silence_is_never_longer_than_the_time_and_never_negative(steps):
    timer = SilenceTimer()
    now = cpu = queued = 0.0
    for span, used, waited, is_runnable in steps:
        now, cpu, queued = now + span, cpu + used, queued + waited
        timer.update(0.0, now, {1: {1: ThreadTime(cpu, queued, is_runnable)}})
        assert 0.0 <= timer.silence_s(1) <= now + 1e-9
        assert 0.0 <= timer.silence_s() <= now + 1e-9
