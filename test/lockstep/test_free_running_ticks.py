"""Free running: timers on the wall clock start the tasks, on the newest samples."""

import pytest

from ballbot_ros.controllers.document.axis import task_timings
from ballbot_ros.lockstep.free_running import NEUTRAL, FreeRunningTicks
from ballbot_ros.lockstep.lockstep import DueTick

MS = 1_000_000
START = 1000 * MS
TASKS = task_timings(20, 100)
INIT, TS1, TS2, TS3, LCD = (task.name for task in TASKS)
NEEDED = ['gyro', 'encoder', 'battery']


class Ticks:
    """The ticks of a controller; wall times in ms."""

    def __init__(self, *, begun=True):
        self.ticks = FreeRunningTicks(
            every_tick=TS1, clock='gyro', needed=NEEDED, sticks='gamepad', tick_ns=4 * MS
        )
        if begun:
            self.ticks.begin(START, TASKS)

    def take(self, *names, stamp_ms=1000, at_ms=0, value='value'):
        for name in names:
            self.ticks.take(name, stamp_ms * MS, value, round(at_ms * MS))

    def fire(self, task, at_ms):
        return self.ticks.on_timer(task, round(at_ms * MS))

    def run(self, *tasks, at_ms):
        """Fire timers, that of the ticks last; return the names of the tasks that run."""
        for task in tasks:
            assert self.fire(task, at_ms) is None
        return self.fire(TS1, at_ms).tasks


@pytest.mark.parametrize('lacking', NEEDED)
def test_the_first_tick_runs_when_all_needed_samples_have_arrived(lacking):
    ticks = Ticks()
    ticks.take(*(name for name in NEEDED if name != lacking))
    assert ticks.fire(TS1, 0) is None
    ticks.take(lacking)
    assert ticks.fire(TS1, 4) == DueTick(START, (INIT, TS1, TS2, TS3, LCD), (TS2, TS3, LCD))
    assert ticks.fire(TS1, 8) == DueTick(START, (TS1,), ())


def test_a_run_begins_without_releases():
    ticks = Ticks()
    ticks.fire(TS2, 0)
    ticks.ticks.begin(START, TASKS)
    ticks.take(*NEEDED)
    assert ticks.fire(TS1, 4).untimed == (TS2, TS3, LCD)


def test_a_task_runs_at_the_tick_after_its_timer_fired():
    ticks = Ticks()
    ticks.take(*NEEDED)
    assert len(ticks.run(at_ms=0)) == 5
    assert ticks.run(at_ms=4) == (TS1,)
    assert ticks.run(TS2, at_ms=20) == (TS1, TS2)
    assert ticks.run(at_ms=24) == (TS1,)
    assert ticks.run(LCD, TS2, TS3, at_ms=500) == (TS1, TS2, TS3, LCD)
    # A second callback before the tick changes nothing.
    assert ticks.run(TS2, TS2, at_ms=520) == (TS1, TS2)
    assert ticks.run(at_ms=524) == (TS1,)
    assert ticks.ticks.fired == {TS1: 7, TS2: 4, TS3: 1, LCD: 1}


def test_the_newest_sample_wins():
    ticks = Ticks()
    ticks.take(*NEEDED, value='old')
    ticks.take('gyro', stamp_ms=1008, value='new')
    ticks.take('gyro', stamp_ms=1004, value='late')
    assert ticks.fire(TS1, 0).time_ns == 1008 * MS
    assert ticks.ticks.gate.newest('gyro') == 'new'
    assert ticks.ticks.gate.newest('encoder') == 'old'


def test_samples_without_a_run_or_of_an_earlier_one_are_ignored():
    ticks = Ticks(begun=False)
    ticks.take(*NEEDED)
    assert ticks.fire(TS1, 0) is None
    ticks.ticks.begin(START, TASKS)
    ticks.take(*NEEDED, stamp_ms=996)
    assert ticks.fire(TS1, 4) is None


def test_another_run_begins_with_all_tasks_and_without_samples():
    ticks = Ticks()
    ticks.take(*NEEDED)
    ticks.run(at_ms=0)
    ticks.fire(TS2, 20)
    ticks.ticks.begin(START, TASKS)
    assert ticks.fire(TS1, 24) is None
    ticks.take(*NEEDED)
    assert ticks.run(at_ms=500) == (INIT, TS1, TS2, TS3, LCD)
    assert ticks.run(at_ms=504) == (TS1,)
    assert ticks.ticks.late_ticks == 0


def test_ticks_that_come_more_than_a_period_late_are_counted():
    ticks = Ticks()
    ticks.take(*NEEDED)
    for at_ms in (0, 4, 12, 20.5, 24, 40):
        ticks.run(at_ms=at_ms)
    assert ticks.ticks.late_ticks == 2


def test_after_a_silence_of_half_a_second_the_sticks_are_neutral():
    ticks = Ticks()
    ticks.take(*NEEDED)
    newest = ticks.ticks.gate.newest
    ticks.run(at_ms=10_000)
    assert newest('gamepad') is None
    ticks.take('gamepad', value=(50, 50), at_ms=10_002)
    for at_ms in (10_004, 10_502):
        ticks.take('gyro', stamp_ms=at_ms)
        ticks.run(at_ms=at_ms)
        assert newest('gamepad') == (50, 50)
    ticks.take('gyro', stamp_ms=10_503)
    ticks.run(at_ms=10_503)
    assert newest('gamepad') == NEUTRAL
    ticks.take('gamepad', stamp_ms=10_504, value=(60, 60), at_ms=10_505)
    ticks.run(at_ms=10_506)
    assert newest('gamepad') == (60, 60)
