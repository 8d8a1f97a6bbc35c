"""The releases of the tasks: by their timers, by the start of a run, or forced."""

import pytest
from hypothesis import strategies as st
from laws import given

from ballbot_ros.controllers.document.axis import task_timings
from ballbot_ros.lockstep.lockstep import DueTick, TaskReleases
from ballbot_ros.robot.brick.schedule import Schedule

MS = 1_000_000
START_MS = 1000
TASKS = task_timings(20, 100)
INIT, TS1, TS2, TS3, LCD = (task.name for task in TASKS)
PERIODS_MS = {task.name: task.period_ms for task in TASKS if task.period_ms}


def begun():
    releases = TaskReleases()
    releases.begin(START_MS * MS, TASKS)
    return releases


def release(releases, *events):
    for task, now_ms in events:
        releases.release(task, now_ms * MS)


def missing(releases, tick_ms):
    return list(releases.missing(tick_ms * MS))


def test_the_start_of_a_run_releases_the_tasks_due_at_its_first_tick():
    releases = begun()
    assert missing(releases, START_MS) == []
    assert releases.take(START_MS * MS) == DueTick(
        START_MS * MS, (INIT, TS1, TS2, TS3, LCD), (TS1, TS2, TS3, LCD)
    )
    assert releases.forced == 0


def test_after_the_first_tick_the_timers_release_the_tasks():
    releases = begun()
    assert missing(releases, 1020) == [TS1, TS2]
    release(releases, (TS2, 1020))
    assert missing(releases, 1020) == [TS1]
    release(releases, (TS1, 1020))
    assert missing(releases, 1020) == []
    assert releases.take(1020 * MS) == DueTick(1020 * MS, (TS1, TS2), ())


@pytest.mark.parametrize(
    'event',
    [
        (TS2, 1020),  # a second one
        (TS2, 1024),  # off the schedule
        (TS2, 1016),
        (TS2, 1000),  # of an earlier time
        (TS2, 980),
        (TS2, 20),  # of another run
        (INIT, 1020),  # of a task without a timer
        ('task_of_somebody_else', 1020),
    ],
)
def test_an_invalid_release_changes_nothing(event):
    releases = begun()
    release(releases, event)
    assert missing(releases, 1024) == [TS1]
    release(releases, (TS2, 1020), event, (TS1, 1020))
    assert missing(releases, 1020) == []
    assert releases.take(1020 * MS).tasks == (TS1, TS2)
    assert missing(releases, 1040) == [TS1, TS2]


def test_the_schedule_counts_from_the_start_of_the_run():
    releases = TaskReleases()
    releases.begin(1100 * MS, TASKS)
    release(releases, *((task, 1600) for task in PERIODS_MS))
    assert missing(releases, 1600) == []


@pytest.mark.parametrize('task', PERIODS_MS)
def test_forced_releases_are_counted_and_their_timers_must_be_restarted(task):
    releases = begun()
    tick_ms = 1500
    release(releases, *((name, tick_ms) for name in PERIODS_MS if name != task))
    assert missing(releases, tick_ms) == [task]
    releases.force(tick_ms * MS)
    assert releases.forced == 1
    assert missing(releases, tick_ms) == []
    assert releases.take(tick_ms * MS) == DueTick(tick_ms * MS, (TS1, TS2, TS3, LCD), (task,))
    # A late release does not count for the next tick.
    release(releases, (task, tick_ms))
    assert missing(releases, tick_ms + 500) == list(PERIODS_MS)


def test_existing_releases_are_not_counted_as_forced():
    releases = begun()
    releases.force(START_MS * MS)
    release(releases, (TS1, 1004))
    releases.force(1004 * MS)
    assert releases.forced == 0


def test_another_run_begins_without_releases_but_keeps_the_counts():
    releases = begun()
    release(releases, (TS1, 1004))
    releases.force(1020 * MS)
    releases.begin(1000 * MS, task_timings(4, 4))
    assert missing(releases, 1000) == []
    assert missing(releases, 1004) == [TS1, TS2, TS3]
    assert missing(releases, 1020) == [TS1, TS2, TS3]
    assert releases.fired[TS1] == 1
    assert releases.forced == 2


def test_before_a_run_callbacks_only_count():
    releases = TaskReleases()
    release(releases, (TS1, 1004), (TS2, 1020))
    assert releases.fired == {TS1: 1, TS2: 1}
    releases.begin(START_MS * MS, TASKS)
    assert missing(releases, 1020) == [TS1, TS2]


@given(st.lists(st.tuples(st.sampled_from(list(PERIODS_MS)), st.integers(900, 1600)), max_size=300))
def test_due_tasks_without_a_release_for_the_tick_are_missing(events):
    releases, schedule = begun(), Schedule(TASKS)
    events = sorted(events, key=lambda event: event[1])
    release(releases, *events)
    assert releases.fired.total() == len(events)
    newest = max((now for _, now in events), default=START_MS)
    for tick_ms in range(START_MS + 4, 1600, 4):
        due = schedule.due(tick_ms - START_MS)
        if tick_ms >= newest:
            assert missing(releases, tick_ms) == [
                task for task in due if (task, tick_ms) not in events
            ]
        assert list(releases.take(tick_ms * MS).tasks) == due
