"""The gate, the run follower and the timer audit."""

import itertools
import random

import pytest

from ballbot_ros.simulation.lockstep import InputGate, RunFollower, TimerAudit
from ballbot_ros.simulation.timing import next_start_ns

MS = 1_000_000
PERIODS = {'gyro': 4 * MS, 'sonar': 20 * MS, 'battery': 100 * MS}
START = 1000 * MS


def test_the_gate_opens_when_all_that_is_due_is_in_whatever_the_order():
    for order in itertools.permutations(PERIODS):
        gate = InputGate(PERIODS)
        for name in order:
            assert not gate.ready(START)
            assert gate.put(name, START, name.upper())
        assert gate.ready(START)
        assert gate.missing(START) == []
        assert [gate.newest(name) for name in PERIODS] == ['GYRO', 'SONAR', 'BATTERY']


def test_only_what_is_due_is_waited_for():
    gate = InputGate(PERIODS)
    gate.put('gyro', START + 4 * MS, 1)
    assert gate.ready(START + 4 * MS)
    gate.put('gyro', START + 20 * MS, 1)
    assert gate.missing(START + 20 * MS) == ['sonar']
    assert gate.missing(START + 100 * MS) == ['gyro', 'sonar', 'battery']


def test_a_sample_that_comes_again_changes_nothing():
    gate = InputGate(PERIODS)
    assert gate.put('gyro', START, 'first')
    assert not gate.put('gyro', START, 'again')
    assert not gate.put('gyro', START - 4 * MS, 'old')
    assert gate.newest('gyro') == 'first'
    assert gate.stamp('gyro') == START


def test_before_the_first_sample_and_after_a_clear_there_is_none():
    gate = InputGate(PERIODS)
    assert gate.newest('gyro') is gate.stamp('gyro') is None
    gate.put('gyro', START, 1)
    gate.clear()
    assert gate.newest('gyro') is gate.stamp('gyro') is None
    assert gate.put('gyro', START - 4 * MS, 2)


@pytest.mark.parametrize('seed', range(10))
def test_lost_doubled_and_late_samples_do_not_change_the_sequence_of_ticks(seed):
    chance = random.Random(seed)
    gate = InputGate({'a': 4 * MS, 'b': 20 * MS})
    now, ticks = START, []
    while len(ticks) < 15:
        due = [name for name, period in (('a', 4), ('b', 20)) if now % (period * MS) == 0]
        name = chance.choice(['a', 'b'])
        stamp = now if name in due and chance.random() < 0.5 else now - 20 * MS
        gate.put(name, stamp, stamp)
        if gate.ready(now):
            assert all(gate.newest(each) == now for each in due)
            ticks.append(now)
            now += 4 * MS
    assert ticks == [START + n * 4 * MS for n in range(15)]


def test_time_counts_from_the_start_of_the_announced_run():
    run = RunFollower()
    assert run.elapsed_ns(START, 20 * MS) is None
    assert run.announced(START, '1 abc')
    assert run.elapsed_ns(START, 20 * MS) == 0
    assert run.elapsed_ns(START + 20 * MS, 20 * MS) == 20 * MS
    assert run.elapsed_ns(START + 20 * MS, 20 * MS) == 20 * MS


def test_an_announcement_that_comes_again_is_not_a_new_run():
    run = RunFollower()
    assert run.announced(START, '1 abc')
    assert not run.announced(START, '1 abc')
    assert run.announced(START, '2 abc')


def test_a_sample_that_overtakes_its_announcement_waits_for_it():
    run = RunFollower()
    run.announced(START, '1 abc')
    assert run.elapsed_ns(START, 20 * MS) == 0
    assert run.elapsed_ns(START + 100 * MS, 20 * MS) is None
    run.announced(START + 100 * MS, '2 abc')
    assert run.elapsed_ns(START + 100 * MS, 20 * MS) == 0


@pytest.mark.parametrize('reset_ms', [0, 40, 76, 80, 96, 100, 176, 196])
def test_a_reset_at_any_time_begins_a_run_that_is_not_taken_for_the_old_one(reset_ms):
    run = RunFollower()
    run.announced(START, '1 abc')
    for sample_ms in range(0, reset_ms + 1, 20):
        assert run.elapsed_ns(START + sample_ms * MS, 20 * MS) == sample_ms * MS
    new_start = next_start_ns(START + reset_ms * MS)
    assert run.elapsed_ns(new_start, 20 * MS) is None
    run.announced(new_start, '2 abc')
    assert run.elapsed_ns(new_start, 20 * MS) == 0


def test_a_sample_of_the_run_before_belongs_to_no_known_run():
    run = RunFollower()
    run.announced(START + 100 * MS, '2 abc')
    assert run.elapsed_ns(START, 20 * MS) is None
    assert run.elapsed_ns(START + 100 * MS, 20 * MS) == 0


def test_a_follower_may_join_in_mid_run():
    run = RunFollower()
    run.announced(START, '1 abc')
    assert run.elapsed_ns(START + 500 * MS, 20 * MS) == 500 * MS


def audit(*times_ms, period_ms=20):
    """Return the audit of a timer that fired at these times of a run."""
    result = TimerAudit(period_ms * MS)
    for time in times_ms:
        result.fire(START + time * MS, START)
    return result


def test_a_timer_that_keeps_its_period_never_disagrees():
    assert audit(*range(0, 1000, 20)).disagreements == 0
    assert audit(*range(0, 1000, 20)).fired == 50
    assert audit(100, 120, 140).disagreements == 0


def test_every_wrong_doubled_or_missing_callback_is_counted():
    assert audit(0, 20, 20, 40).disagreements == 1
    assert audit(0, 20, 30, 40).disagreements == 1
    assert audit(0, 20, 30, 60).disagreements == 2
    assert audit(0, 20, 60, 80).disagreements == 1
    assert audit(0, 20, 120).disagreements == 4


def test_before_the_start_of_the_run_nothing_is_expected():
    assert audit(-60, -10, -3, 0, 20).disagreements == 0


def test_a_new_run_is_not_a_disagreement():
    timer = audit(0, 20)
    timer.restart()
    timer.fire(START + 300 * MS, START + 300 * MS)
    assert timer.disagreements == 0


def test_a_shuffled_timer_is_found_out():
    times = list(range(0, 1000, 20))
    random.Random(1).shuffle(times)
    assert audit(*times).disagreements > 10
