"""The gate, the controller's inputs, the history of samples and the timer audit."""

import itertools
import random

import pytest

from ballbot_ros.simulation.lockstep import InputGate, LockstepInputs, Run, Step, TimerAudit
from ballbot_ros.simulation.sample_history import DEPTH, Sample, SampleHistory

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


def bare(one, other):
    return one == other


class Inputs:
    """The inputs of a controller that waits for a run."""

    def __init__(self, start_ms=1000):
        self.inputs = LockstepInputs(
            PERIODS,
            first='battery',
            every_tick='gyro',
            is_same=dict.fromkeys(PERIODS, bare),
            tick_ns=4 * MS,
        )
        self.ticks = []
        if start_ms is not None:
            self.inputs.begin(start_ms * MS)

    def take(self, name, stamp_ms, data=b'true'):
        step = self.inputs.take(name, stamp_ms * MS, data, data)
        if step is Step.TICK:
            self.ticks.append(self.inputs.next_ns // MS)
            self.inputs.ticked()
        return step

    def take_all(self, *events):
        return [self.take(*event) for event in events]


FIRST = (('battery', 1000), ('gyro', 1000), ('sonar', 1000))
IGNORE, KEEP, TICK, AGAIN, OBJECT, MISSED = (
    Step.IGNORE, Step.KEEP, Step.TICK, Step.ANSWER_AGAIN, Step.OBJECT, Step.MISSED_START,
)  # fmt: skip


@pytest.mark.parametrize(
    ('events', 'steps'),
    [
        # The plant itself opens the run; what comes before that is of another one.
        (FIRST, (KEEP, KEEP, TICK)),
        ((('gyro', 1000), ('sonar', 1000), *FIRST), (IGNORE, IGNORE, KEEP, KEEP, TICK)),
        ((('gyro', 5000), ('sonar', 400), *FIRST), (IGNORE, IGNORE, KEEP, KEEP, TICK)),
        ((('gyro', 1000, b'of another run'), *FIRST), (IGNORE, KEEP, KEEP, TICK)),
        ((('battery', 900), ('gyro', 1000), *FIRST), (IGNORE, IGNORE, KEEP, KEEP, TICK)),
        # Only one sample a stamp.
        ((*FIRST, ('gyro', 1000, b'other')), (KEEP, KEEP, TICK, OBJECT)),
        ((*FIRST, ('sonar', 1000, b'other')), (KEEP, KEEP, TICK, OBJECT)),
        ((*FIRST, ('battery', 1000, b'other')), (KEEP, KEEP, TICK, OBJECT)),
        ((*FIRST[:2], ('gyro', 1000, b'other')), (KEEP, KEEP, OBJECT)),
        ((*FIRST, ('gyro', 1004), ('gyro', 1000, b'other')), (KEEP, KEEP, TICK, TICK, OBJECT)),
        # Asked again, it answers again, but only for the tick before.
        ((*FIRST, ('gyro', 1000)), (KEEP, KEEP, TICK, AGAIN)),
        ((*FIRST, ('gyro', 1004), ('gyro', 1000)), (KEEP, KEEP, TICK, TICK, IGNORE)),
        ((*FIRST, ('gyro', 1004), ('sonar', 1000)), (KEEP, KEEP, TICK, TICK, IGNORE)),
        # Nobody is ahead of the plant.
        ((*FIRST, ('gyro', 1008)), (KEEP, KEEP, TICK, OBJECT)),
        ((*FIRST, ('sonar', 10**12)), (KEEP, KEEP, TICK, OBJECT)),
        ((*FIRST, ('gyro', 0), ('gyro', 996)), (KEEP, KEEP, TICK, IGNORE, IGNORE)),
        # A controller that comes later has missed the start.
        ((('gyro', 1400), ('battery', 1400), ('gyro', 1404)), (IGNORE, KEEP, MISSED)),
        ((('battery', 1000), ('gyro', 1004)), (KEEP, MISSED)),
        # One of another clock is not kept in the place of the first one.
        ((('battery', 1000), ('gyro', 5000), *FIRST[1:]), (KEEP, MISSED, KEEP, TICK)),
        ((('battery', 1000), ('sonar', 10**12), *FIRST[1:]), (KEEP, IGNORE, KEEP, TICK)),
    ],
)
def test_what_a_sample_leads_to(events, steps):
    inputs = Inputs()
    assert inputs.take_all(*events) == list(steps)
    assert inputs.ticks == [1000, 1004][: steps.count(TICK)]


def test_before_a_run_is_known_nothing_counts():
    assert set(Inputs(None).take_all(*FIRST)) == {IGNORE}


@pytest.mark.parametrize('start_ms', [1000, 1100, 1500])
def test_another_run_begins_with_nothing_of_the_one_before(start_ms):
    inputs = Inputs()
    inputs.take_all(*FIRST, ('gyro', 1004), ('gyro', 1008))
    inputs.inputs.begin(start_ms * MS)
    assert inputs.inputs.gate.stamp('gyro') is None
    ticks = len(inputs.ticks)
    steps = inputs.take_all(
        ('gyro', 1012), *((name, start_ms, b'another') for name in ('battery', 'gyro', 'sonar'))
    )
    assert steps == [IGNORE, KEEP, KEEP, TICK]
    assert inputs.ticks[ticks:] == [start_ms]


def test_a_controller_may_begin_afresh_with_the_next_whole_set_of_inputs():
    inputs = Inputs()
    assert inputs.take_all(('battery', 1500), ('gyro', 1520)) == [KEEP, MISSED]
    inputs.inputs.begin_afresh(1520 * MS)
    assert inputs.take_all(('sonar', 1520), ('gyro', 1520), ('gyro', 1524)) == [KEEP, TICK, TICK]
    assert inputs.ticks == [1520, 1524]


@pytest.mark.parametrize('seed', range(30))
def test_whatever_is_repeated_left_over_or_reordered_the_ticks_are_the_same(seed):
    chance = random.Random(seed)
    inputs = Inputs()

    def take_something_of_another_run():
        event = (chance.choice(list(PERIODS)), 4 * chance.randrange(250), b'old')
        assert inputs.take(*event) is IGNORE

    take_something_of_another_run()
    inputs.take('battery', 1000)
    for now in range(1000, 1200, 4):
        due = [name for name, period in PERIODS.items() if now * MS % period == 0]
        events = [*due, *chance.choices(due, k=chance.randrange(3))]
        chance.shuffle(events)
        for name in events:
            assert inputs.take(name, now) in (KEEP, TICK, AGAIN, IGNORE)
            take_something_of_another_run()
    assert inputs.ticks == list(range(1000, 1200, 4))


def test_the_name_of_a_run_tells_its_plant():
    assert Run('3 18ab', START).plant == Run('4 18ab', START).plant == '18ab'
    assert Run('3 18ab', START).plant != Run('3 18ac', START).plant
    assert Run('1', START).plant == ''


def test_a_sample_is_new_repeated_contradicting_or_old():
    history = SampleHistory(bare)
    assert history.judge(20, b'a') is Sample.NEW
    assert history.judge(20, b'a') is Sample.REPEATED
    assert history.judge(20, b'b') is Sample.CONTRADICTING
    assert history.judge(10, b'c') is Sample.OLD
    assert history.judge(30, b'b') is Sample.NEW
    assert history.judge(20, b'b') is Sample.CONTRADICTING
    assert history.judge(20, b'a') is Sample.REPEATED
    history.clear()
    assert history.judge(10, b'c') is Sample.NEW


def test_a_history_forgets_what_is_long_ago():
    history = SampleHistory(bare)
    for stamp in range(100):
        history.judge(stamp, b'a')
    assert history.judge(99, b'b') is history.judge(99 - DEPTH + 1, b'b') is Sample.CONTRADICTING
    assert history.judge(99 - DEPTH, b'b') is Sample.OLD


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
