"""The gate, the controller's decisions in lockstep, and the history of samples."""

import itertools
import random

import pytest
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, rule
from laws import settings

from ballbot_ros.controllers.document.axis import task_timings
from ballbot_ros.lockstep.lockstep import (
    DEPTH,
    DueTick,
    InputGate,
    LockstepTicks,
    RunIdentity,
    SampleHistory,
    SampleReaction,
    SampleStatus,
    TaskReleases,
)
from ballbot_ros.robot.brick.schedule import Schedule

MS = 1_000_000
PERIODS = {'gyro': 4 * MS, 'sonar': 20 * MS, 'battery': 100 * MS}
START = 1000 * MS


def test_the_gate_opens_when_all_due_samples_have_arrived_in_any_order():
    for order in itertools.permutations(PERIODS):
        gate = InputGate(PERIODS)
        for name in order:
            assert not gate.ready(START)
            assert gate.put(name, START, name.upper())
        assert gate.ready(START)
        assert [gate.newest(name) for name in PERIODS] == ['GYRO', 'SONAR', 'BATTERY']


def test_only_due_samples_are_awaited():
    gate = InputGate(PERIODS)
    gate.put('gyro', START + 4 * MS, 1)
    assert gate.ready(START + 4 * MS)
    gate.put('gyro', START + 20 * MS, 1)
    assert not gate.ready(START + 20 * MS)
    gate.put('sonar', START + 20 * MS, 1)
    assert gate.ready(START + 20 * MS)
    assert not gate.ready(START + 100 * MS)


def test_a_repeated_sample_changes_nothing():
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


TASKS = task_timings(20, 100)
INIT, TS1, TS2, TS3, LCD = (task.name for task in TASKS)
PERIODS_MS = {task.name: task.period_ms for task in TASKS if task.period_ms}
SCHEDULE = Schedule(TASKS)


def due_inputs(now_ms):
    return [name for name, period in PERIODS.items() if now_ms * MS % period == 0]


def due_timers(now_ms):
    return [task for task in SCHEDULE.due(now_ms - 1000) if task in PERIODS_MS]


class Ticks:
    """The decisions of a controller that waits for a run; an event is a sample or a callback."""

    def __init__(self, start_ms=1000):
        self.ticks = LockstepTicks(
            PERIODS,
            first='battery',
            every_tick='gyro',
            is_same=dict.fromkeys(PERIODS, bare),
            tick_ns=4 * MS,
        )
        self.ran = []
        if start_ms is not None:
            self.ticks.begin(start_ms * MS, TASKS)

    def feed(self, name, time_ms, data=b'true'):
        """Return the step: TICK for a tick that runs, None for a callback without effect."""
        if name in PERIODS:
            result = self.ticks.take(name, time_ms * MS, data, data)
            if result is SampleReaction.FORCE_RELEASES:
                result = self.ticks.force()
        else:
            result = self.ticks.on_timer(name, time_ms * MS)
        if isinstance(result, DueTick):
            self.ran.append(result)
            return TICK
        return result

    def feed_all(self, *events):
        return [self.feed(*event) for event in events]

    def tick(self, now_ms):
        """Feed everything that a tick waits for, its timers first."""
        return self.feed_all(*((name, now_ms) for name in due_timers(now_ms) + due_inputs(now_ms)))

    @property
    def times_ms(self):
        return [tick.time_ns // MS for tick in self.ran]

    @property
    def forced(self):
        return self.ticks.releases.forced


TICK = 'tick'
FIRST = (('battery', 1000), ('gyro', 1000), ('sonar', 1000))
TS1_FIRED = (TS1, 1004)
SECOND = (TS1_FIRED, ('gyro', 1004))
IGNORE, STORE, RESEND, OBJECT, MISSED = (
    SampleReaction.IGNORE, SampleReaction.STORE, SampleReaction.RESEND, SampleReaction.OBJECT,
    SampleReaction.MISSED_START,
)  # fmt: skip
BEGUN = (STORE, STORE, TICK)


REACTIONS = [
    # A sample from the plant itself opens the run; earlier samples belong to another run.
    (FIRST, BEGUN),
    ((('gyro', 1000), ('sonar', 1000), *FIRST), (IGNORE, IGNORE, *BEGUN)),
    ((('gyro', 5000), ('sonar', 400), *FIRST), (IGNORE, IGNORE, *BEGUN)),
    ((('gyro', 1000, b'of another run'), *FIRST), (IGNORE, *BEGUN)),
    ((('battery', 900), ('gyro', 1000), *FIRST), (IGNORE, IGNORE, *BEGUN)),
    # There is only one sample per stamp.
    ((*FIRST, ('gyro', 1000, b'other')), (*BEGUN, OBJECT)),
    ((*FIRST, ('sonar', 1000, b'other')), (*BEGUN, OBJECT)),
    ((*FIRST, ('battery', 1000, b'other')), (*BEGUN, OBJECT)),
    ((*FIRST[:2], ('gyro', 1000, b'other')), (STORE, STORE, OBJECT)),
    ((*FIRST, *SECOND, ('gyro', 1000, b'other')), (*BEGUN, None, TICK, OBJECT)),
    # If asked again, the controller repeats its answer, but only to the previous tick.
    ((*FIRST, ('gyro', 1000)), (*BEGUN, RESEND)),
    ((*FIRST, TS1_FIRED, ('gyro', 1000)), (*BEGUN, None, RESEND)),
    ((*FIRST, *SECOND, ('gyro', 1000)), (*BEGUN, None, TICK, IGNORE)),
    ((*FIRST, *SECOND, ('sonar', 1000)), (*BEGUN, None, TICK, IGNORE)),
    # No sample can be ahead of the plant.
    ((*FIRST, ('gyro', 1008)), (*BEGUN, OBJECT)),
    ((*FIRST, ('sonar', 10**12)), (*BEGUN, OBJECT)),
    ((*FIRST, ('gyro', 0), ('gyro', 996)), (*BEGUN, IGNORE, IGNORE)),
    # A controller that joins later has missed the start.
    ((('gyro', 1400), ('battery', 1400), ('gyro', 1404)), (IGNORE, STORE, MISSED)),
    ((('battery', 1000), ('gyro', 1004)), (STORE, MISSED)),
    # A sample of another clock does not replace the first one.
    ((('battery', 1000), ('gyro', 5000), *FIRST[1:]), (STORE, MISSED, STORE, TICK)),
    ((('battery', 1000), ('sonar', 10**12), *FIRST[1:]), (STORE, STORE, STORE, TICK)),
    # Another controller may have answered the tick that this one still waits for.
    ((*FIRST[:2], ('sonar', 1020), ('gyro', 1004)), (STORE, STORE, STORE, MISSED)),
    # A tick waits for its timers, which may fire in any order.
    ((*FIRST, ('gyro', 1004), TS1_FIRED), (*BEGUN, STORE, TICK)),
    ((*FIRST, ('gyro', 1004), (TS1, 1000), (TS1, 1008)), (*BEGUN, STORE, None, None)),
    ((*FIRST, ('gyro', 1004), (TS1, 1003), TS1_FIRED), (*BEGUN, STORE, None, TICK)),
    ((*FIRST, ('gyro', 1004), (TS2, 1004), TS1_FIRED), (*BEGUN, STORE, None, TICK)),
    ((*FIRST, *SECOND, TS1_FIRED, ('gyro', 1008)), (*BEGUN, None, TICK, None, STORE)),
    # If asked again when all inputs have arrived, the controller forces the releases.
    ((*FIRST, ('gyro', 1004), ('gyro', 1004)), (*BEGUN, STORE, TICK)),
    ((*FIRST, ('gyro', 1004), ('gyro', 1000)), (*BEGUN, STORE, RESEND)),
    # The first tick needs no timer, and a callback does not disturb it.
    (((TS1, 1000), (TS2, 996), *FIRST), (None, None, *BEGUN)),
    ((FIRST[0], (TS1, 1000), *FIRST[1:], (TS2, 1000)), (STORE, None, STORE, TICK, None)),
]


def test_each_event_has_its_reaction():
    for events, steps in REACTIONS:
        ticks = Ticks()
        assert ticks.feed_all(*events) == list(steps), events
        assert ticks.times_ms == [1000, 1004][: steps.count(TICK)], events


def test_a_tick_runs_the_due_tasks_and_names_those_not_released_by_their_timers():
    ticks = Ticks()
    ticks.feed_all(*FIRST)
    assert ticks.ran == [DueTick(1000 * MS, (INIT, TS1, TS2, TS3, LCD), (TS1, TS2, TS3, LCD))]
    for now_ms in range(1004, 1504, 4):
        ticks.tick(now_ms)
    assert ticks.times_ms == list(range(1000, 1504, 4))
    assert ticks.ran[-1] == DueTick(1500 * MS, (TS1, TS2, TS3, LCD), ())
    assert ticks.ran[1] == DueTick(1004 * MS, (TS1,), ())
    assert ticks.forced == 0


def test_a_tick_comes_with_the_last_of_its_inputs_and_releases_in_every_order():
    waited_for = [*PERIODS, TS1, TS2, TS3]
    for order in itertools.permutations(waited_for):
        ticks = Ticks()
        ticks.feed_all(*FIRST)
        for now_ms in range(1004, 1100, 4):
            ticks.tick(now_ms)
        *results, last = ticks.feed_all(*((name, 1100) for name in order))
        assert last == TICK
        assert set(results) == {STORE, None}
        assert ticks.ran[-1] == DueTick(1100 * MS, (TS1, TS2, TS3), ())


@pytest.mark.parametrize('dropped', [(TS1,), (TS2,), (TS3,), (TS1, TS3), (TS1, TS2, TS3)])
def test_a_dropped_callback_stalls_the_tick_until_the_plant_asks_again(dropped):
    for name in PERIODS:
        ticks = Ticks()
        ticks.feed_all(*FIRST)
        for now_ms in range(1004, 1100, 4):
            ticks.tick(now_ms)
        ticks.feed_all(*((task, 1100) for task in (TS1, TS2, TS3) if task not in dropped))
        assert ticks.feed_all(*((each, 1100) for each in PERIODS)) == [STORE] * 3, name
        assert ticks.forced == 0, name
        assert ticks.feed(name, 1100) == TICK, name
        assert ticks.ran[-1] == DueTick(1100 * MS, (TS1, TS2, TS3), dropped), name
        assert ticks.forced == len(dropped), name
        # Late callbacks change nothing, and the next ticks run normally.
        assert ticks.feed_all(*((task, 1100) for task in dropped)) == [None] * len(dropped), name
        assert ticks.tick(1104) == [None, TICK], name
        assert ticks.forced == len(dropped), name


def test_nothing_is_forced_while_an_input_is_missing():
    ticks = Ticks()
    ticks.feed_all(*FIRST)
    for now_ms in range(1004, 1020, 4):
        ticks.tick(now_ms)
    assert ticks.feed_all(('gyro', 1020), ('gyro', 1020)) == [STORE, IGNORE]
    assert ticks.feed_all(('sonar', 1020), (TS2, 1020), (TS1, 1020)) == [STORE, None, TICK]
    assert ticks.forced == 0


def test_it_says_which_samples_it_awaits_and_with_which_other_stamp_they_came():
    ticks = LockstepTicks(
        {'battery': 100 * MS, 'gyro': 4 * MS, 'sonar': 20 * MS},
        first='battery',
        every_tick='gyro',
        is_same=dict.fromkeys(('battery', 'gyro', 'sonar'), lambda one, other: one == other),
        tick_ns=4 * MS,
    )
    assert ticks.awaited() == {}
    ticks.begin(START, [])
    assert ticks.awaited() == {}
    ticks.take('battery', START, b'', 0)
    assert ticks.awaited() == {'gyro': None, 'sonar': None}
    ticks.take('gyro', START - 4 * MS, b'', 0)
    ticks.take('sonar', START, b'', 0)
    assert ticks.awaited() == {'gyro': START - 4 * MS}
    assert isinstance(ticks.take('gyro', START, b'', 0), DueTick)
    assert ticks.awaited() == {'gyro': None}
    ticks.take('gyro', START + 6 * MS, b'', 0)
    assert ticks.awaited() == {'gyro': START + 6 * MS}
    ticks.begin(START + 100 * MS, [])
    assert ticks.awaited() == {}


def test_a_controller_that_has_missed_the_start_awaits_only_what_tells_it_the_present_tick():
    """The samples of the other drivers are right, although not those of the start."""
    ticks = Ticks()
    ticks.feed_all(('battery', 1000), ('sonar', 1060))
    assert ticks.ticks.awaited() == {'gyro': None}
    ticks.feed('gyro', 1056)
    assert ticks.ticks.awaited() == {'gyro': 1056 * MS}


def test_before_a_run_is_known_everything_is_ignored():
    assert set(Ticks(None).feed_all(*FIRST, (TS1, 1000))) == {IGNORE, None}


@pytest.mark.parametrize('start_ms', [1000, 1100, 1500])
def test_another_run_begins_without_anything_of_the_previous_one(start_ms):
    ticks = Ticks()
    ticks.feed_all(*FIRST, *SECOND, (TS1, 1008), ('gyro', 1008))
    ticks.ticks.begin(start_ms * MS, TASKS)
    assert ticks.ticks.gate.stamp('gyro') is None
    ran = len(ticks.ran)
    steps = ticks.feed_all(
        ('gyro', 1012), *((name, start_ms, b'another') for name in ('battery', 'gyro', 'sonar'))
    )
    assert steps == [IGNORE, *BEGUN]
    assert ticks.times_ms[ran:] == [start_ms]
    # A release of the previous run does not count in the new one.
    assert ticks.feed('gyro', start_ms + 4, b'another') == STORE
    assert ticks.feed(TS1, start_ms + 4) == TICK


@pytest.mark.parametrize(
    ('now_ms', 'rejoin', 'reaction'),
    [
        (1520, True, SampleReaction.RESTART),
        (1520, False, SampleReaction.ABORT),
        (1524, True, IGNORE),
        (1524, False, IGNORE),
    ],
)
def test_after_a_missed_start_the_controller_begins_at_the_current_tick_or_not_at_all(
    now_ms, rejoin, reaction
):
    ticks = Ticks()
    assert ticks.feed_all(('battery', 1500), ('gyro', 1520)) == [STORE, MISSED]
    assert ticks.ticks.on_missed_start(1520 * MS, now_ns=now_ms * MS, rejoin=rejoin) is reaction
    assert ticks.feed('sonar', 1520) is STORE
    restarts = reaction is SampleReaction.RESTART
    assert ticks.ticks.gate.ready(1520 * MS) is restarts


def test_a_rejoined_run_forces_the_first_releases_and_counts_them():
    ticks = Ticks()
    ticks.feed_all(('battery', 1500), ('gyro', 1520))
    ticks.ticks.on_missed_start(1520 * MS, now_ns=1520 * MS, rejoin=True)
    assert ticks.feed_all(('sonar', 1520), ('gyro', 1520)) == [STORE, TICK]
    assert ticks.ran == [DueTick(1520 * MS, (TS1, TS2), (TS1, TS2))]
    assert ticks.forced == 2
    assert ticks.tick(1524) == [None, TICK]
    assert ticks.forced == 2


def test_a_controller_that_rejoins_repeats_no_answer_that_it_has_not_given():
    """The tick before the one that it rejoins at is due for the battery."""
    ticks = Ticks()
    ticks.feed_all(('battery', 1500), ('gyro', 1504))
    ticks.ticks.on_missed_start(1504 * MS, now_ns=1504 * MS, rejoin=True)
    assert ticks.feed_all(('battery', 1500), ('gyro', 1504)) == [IGNORE, TICK]


def test_a_controller_that_rejoins_has_what_came_before_the_present_tick_was_known():
    """Otherwise it would await samples that their drivers have already sent."""
    ticks = Ticks()
    ticks.feed_all(('battery', 1500), ('sonar', 1520), ('gyro', 1520))
    ticks.ticks.on_missed_start(1520 * MS, now_ns=1520 * MS, rejoin=True)
    assert ticks.ticks.awaited() == {}
    assert ticks.feed('gyro', 1520) == TICK


def test_a_controller_that_has_answered_nothing_may_rejoin_again_at_a_later_tick():
    """A paused plant may step with the answer of the controller before it."""
    ticks = Ticks()
    ticks.feed_all(('battery', 1500), ('gyro', 1520))
    ticks.ticks.on_missed_start(1520 * MS, now_ns=1520 * MS, rejoin=True)
    assert ticks.feed_all(('sonar', 1540), ('gyro', 1524)) == [STORE, MISSED]
    ticks.ticks.on_missed_start(1524 * MS, now_ns=1524 * MS, rejoin=True)
    assert ticks.feed('gyro', 1524) == TICK
    assert ticks.times_ms == [1524]


def shuffled(seed):
    """Return the ticks of a run whose messages are repeated, reordered and mixed with others'."""
    chance = random.Random(seed)
    ticks = Ticks()

    def take_something_of_another_run():
        event = (chance.choice(list(PERIODS)), 4 * chance.randrange(250), b'old')
        assert ticks.feed(*event) is IGNORE, seed

    take_something_of_another_run()
    ticks.feed('battery', 1000)
    for now in range(1000, 1200, 4):
        inputs, timers = due_inputs(now), due_timers(now)
        # While an input is missing, a repeated sample requests nothing.
        events = [*inputs[1:], *chance.choices(inputs[1:] or [TS1], k=2), *timers, *timers]
        chance.shuffle(events)
        for name in [*events, inputs[0], *chance.choices(inputs, k=chance.randrange(3))]:
            assert ticks.feed(name, now) in (STORE, TICK, RESEND, IGNORE, None), seed
            take_something_of_another_run()
    return ticks


def test_repeated_leftover_or_reordered_messages_do_not_change_the_ticks():
    for seed in range(30):
        ticks = shuffled(seed)
        assert ticks.times_ms == list(range(1000, 1200, 4)), seed
        assert ticks.forced == 0, seed


class Disturbed(RuleBasedStateMachine):
    """A run whose samples and callbacks are dropped, repeated, shifted and reordered at random.

    The plant's time is that of the unanswered tick. This class keeps a simple second account of
    what the controller has received, to know whether it may wait.
    """

    def __init__(self):
        super().__init__()
        self.ticks = Ticks()
        self.now_ms = 1000
        self.samples, self.fires = set(), set()
        self.is_open = False
        self.forced = 0

    def deliver(self, name, stamp_ms):
        is_pending = stamp_ms == self.now_ms
        is_again = (name, stamp_ms) in self.samples
        is_forced = is_pending and is_again and not self.missing_inputs()
        if is_forced:
            self.forced += len(self.missing_timers())
        self.is_open = self.is_open or name == 'battery'
        if self.is_open:
            self.samples.add((name, stamp_ms))
        self.take(name, stamp_ms, is_forced=is_forced)

    def take(self, name, time_ms, *, is_forced=False):
        step = self.ticks.feed(name, time_ms)
        assert step not in (OBJECT, MISSED)
        if step == TICK:
            assert not self.missing_inputs()
            assert is_forced or not self.missing_timers()
            self.now_ms += 4

    def missing_inputs(self):
        return [each for each in due_inputs(self.now_ms) if (each, self.now_ms) not in self.samples]

    def missing_timers(self):
        if self.now_ms == 1000:
            return []
        return [each for each in due_timers(self.now_ms) if (each, self.now_ms) not in self.fires]

    @rule(name=st.sampled_from(list(PERIODS)))
    def a_new_or_repeated_sample_arrives(self, name):
        period_ms = PERIODS[name] // MS
        self.deliver(name, self.now_ms - self.now_ms % period_ms)

    @rule(name=st.sampled_from(list(PERIODS)), age=st.integers(1, 5))
    def an_old_sample_arrives(self, name, age):
        period_ms = PERIODS[name] // MS
        stamp_ms = self.now_ms - self.now_ms % period_ms - age * period_ms
        assert self.ticks.feed(name, stamp_ms) in (IGNORE, RESEND)

    @rule(task=st.sampled_from(list(PERIODS_MS)))
    def a_timer_fires(self, task):
        self.fires.add((task, self.now_ms))
        self.take(task, self.now_ms)

    @rule(task=st.sampled_from(list(PERIODS_MS)), shift_ms=st.sampled_from([-1, 1, 2, 3]))
    def a_timer_fires_off_schedule(self, task, shift_ms):
        self.take(task, self.now_ms + shift_ms)

    @rule(task=st.sampled_from(list(PERIODS_MS)), age=st.integers(1, 5))
    def a_timer_fires_late(self, task, age):
        period_ms = PERIODS_MS[task]
        self.take(task, self.now_ms - self.now_ms % period_ms - age * period_ms)

    @rule(chance=st.randoms(use_true_random=False), count=st.integers(1, 60))
    def some_ticks_run_normally(self, chance, count):
        for _ in range(count):
            now = self.now_ms
            timers = [(self.fires.add, self.take, each) for each in self.missing_timers()]
            inputs = [(None, self.deliver, each) for each in self.missing_inputs()]
            events = timers + inputs
            chance.shuffle(events)
            if not self.is_open:
                self.deliver('battery', now)
            for note, event, each in events:
                if note:
                    note((each, now))
                if note or (each, now) not in self.samples:
                    event(each, now)
            assert self.now_ms == now + 4

    @rule(chance=st.randoms(use_true_random=False))
    def the_plant_asks_again(self, chance):
        asked_ms = self.now_ms
        for _ in range(2):
            names = due_inputs(asked_ms)
            chance.shuffle(names)
            if not self.is_open:
                self.deliver('battery', asked_ms)
            for name in names:
                if self.now_ms == asked_ms:
                    self.deliver(name, asked_ms)
        assert self.now_ms == asked_ms + 4

    @invariant()
    def every_tick_has_run_the_tasks_of_the_schedule(self):
        assert [(tick.time_ns // MS, list(tick.tasks)) for tick in self.ticks.ran] == [
            (now_ms, SCHEDULE.due(now_ms - 1000)) for now_ms in range(1000, self.now_ms, 4)
        ]

    @invariant()
    def it_waits_only_for_missing_events(self):
        assert self.missing_inputs() or self.missing_timers()

    @invariant()
    def forced_releases_are_counted(self):
        assert self.ticks.forced == self.forced


TestDisturbed = Disturbed.TestCase
TestDisturbed.settings = settings()


# The releases of the tasks, beyond what the ticks show.


def releases_from(start_ms, *events):
    releases = TaskReleases()
    releases.begin(start_ms * MS, TASKS)
    for task, now_ms in events:
        releases.release(task, now_ms * MS)
    return releases


def test_the_schedule_counts_from_the_start_of_the_run():
    releases = releases_from(1100, *((task, 1600) for task in PERIODS_MS))
    assert releases.missing(1600 * MS) == ()


def test_existing_releases_are_not_counted_as_forced():
    releases = releases_from(1000, (TS1, 1004))
    for now_ms in (1000, 1004):
        releases.force(now_ms * MS)
    assert releases.forced == 0


def test_another_run_begins_without_releases_but_keeps_the_counts():
    releases = releases_from(1000, (TS1, 1004))
    releases.force(1020 * MS)
    releases.begin(1000 * MS, task_timings(4, 4))
    assert releases.missing(1004 * MS) == (TS1, TS2, TS3)
    assert (releases.fired[TS1], releases.forced) == (1, 2)


def test_the_name_of_a_run_identifies_its_plant():
    assert RunIdentity('3 18ab', START).plant == RunIdentity('4 18ab', START).plant == '18ab'
    assert RunIdentity('3 18ab', START).plant != RunIdentity('3 18ac', START).plant
    assert RunIdentity('1', START).plant == ''


def test_a_sample_is_new_duplicate_conflicting_or_old():
    history = SampleHistory(bare)
    assert history.classify(20, b'a') is SampleStatus.NEW
    assert history.classify(20, b'a') is SampleStatus.DUPLICATE
    assert history.classify(20, b'b') is SampleStatus.CONFLICTING
    assert history.classify(10, b'c') is SampleStatus.OLD
    assert history.classify(30, b'b') is SampleStatus.NEW
    assert history.classify(20, b'b') is SampleStatus.CONFLICTING
    assert history.classify(20, b'a') is SampleStatus.DUPLICATE
    history.clear()
    assert history.classify(10, b'c') is SampleStatus.NEW


def test_a_history_forgets_old_samples():
    history = SampleHistory(bare)
    for stamp in range(100):
        history.classify(stamp, b'a')
    assert (
        history.classify(99, b'b')
        is history.classify(99 - DEPTH + 1, b'b')
        is SampleStatus.CONFLICTING
    )
    assert history.classify(99 - DEPTH, b'b') is SampleStatus.OLD
