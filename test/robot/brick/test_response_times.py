"""Response times: the analysis against the kernel, on drawn tasks, and against worked examples."""

import pytest
from hypothesis import example
from hypothesis import strategies as st
from laws import given, settings

from ballbot_ros.robot.brick.kernel import TICK_US, KernelConstants, OsekKernel
from ballbot_ros.robot.brick.response_times import (
    TaskTime,
    late_interrupts,
    simulated_responses,
    worst_responses,
)
from ballbot_ros.robot.brick.schedule import TaskTiming

HORIZON_US = 60_000


def kernel_constants(interrupt_us=10, *, has_defect=False):
    return KernelConstants(interrupt_us, 5, 230, True, has_defect)


def tasks_of(*rows):
    """Return tasks for rows of priority, period [ms] and time [µs]; their names are numbers."""
    return [
        TaskTime(TaskTiming(str(number), priority, period), time_us)
        for number, (priority, period, time_us) in enumerate(rows)
    ]


@st.composite
def task_sets(draw):
    """Return tasks, many of which share a priority, run once or need more than there is."""
    count = draw(st.integers(1, 6))
    periods = draw(
        st.sampled_from([range(1, 21), (4, 8, 12, 20), (0, 4, 20, 100), (0, 1, 2, 3), (6, 10, 15)])
    )
    most = draw(st.sampled_from([300, 1000, 2500, 6000]))
    row = st.tuples(
        st.integers(1, draw(st.sampled_from([2, 6]))),
        st.sampled_from(periods),
        st.integers(1, most),
    )
    return tasks_of(*draw(st.lists(row, min_size=count, max_size=count)))


interrupts = st.sampled_from([0, 1, 10, 130, 300])


# Interrupts that have waited make those with the next alarms wait, too.
CATCHING_UP = (
    tasks_of((6, 2, 187), (3, 2, 200), (3, 2, 218), (5, 2, 668), (6, 2, 389), (5, 2, 231)), 300,
    tasks_of((6, 12, 41), (1, 12, 400), (3, 8, 424), (3, 12, 25), (4, 20, 746), (2, 4, 778)), 700,
)  # fmt: skip


@example(*CATCHING_UP[:2], True)
@example(*CATCHING_UP[2:], True)
@settings(max_examples=400)
@given(task_sets(), interrupts, st.booleans())
def test_no_job_exceeds_the_analysis_and_what_is_exact_happens(tasks, interrupt_us, has_defect):
    constants = kernel_constants(interrupt_us, has_defect=has_defect)
    worst = worst_responses(constants, tasks)
    simulated = simulated_responses(constants, tasks, HORIZON_US)
    for task, (limit_us, is_exact), (longest_us, lost) in zip(tasks, worst, simulated, strict=True):
        if limit_us is None:
            continue
        assert (longest_us or 0) <= limit_us
        if is_exact and limit_us < HORIZON_US:
            assert longest_us == limit_us
        if lost:
            assert limit_us > TICK_US * task.timing.period_ms > 0


@settings(max_examples=200)
@given(
    task_sets(), interrupts, st.booleans(), st.lists(st.floats(0.0, 1.0), min_size=7, max_size=7)
)
def test_no_job_exceeds_the_analysis_if_jobs_take_less(tasks, interrupt_us, has_defect, shares):
    constants = kernel_constants(interrupt_us, has_defect=has_defect)
    limits = [limit_us for limit_us, _ in worst_responses(constants, tasks)]
    kernel = OsekKernel(constants, [task.timing for task in tasks])
    begun = 0
    while (event := kernel.next_event(HORIZON_US)) >= 0:
        number, is_end = divmod(event, 2)
        if is_end:
            job = kernel.ended(number)
            response_us = job.end - job.release // TICK_US * TICK_US
            assert limits[number] is None or response_us <= limits[number]
        else:
            kernel.take_time(number, round(shares[begun % 7] * tasks[number].time_us))
            begun += 1


@pytest.mark.parametrize('has_defect', [False, True])
def test_the_drawn_tasks_are_of_all_kinds(has_defect):
    kinds, late = set(), set()

    @settings(max_examples=200)
    @given(task_sets())
    def collect(tasks):
        constants = kernel_constants(has_defect=has_defect)
        late.add(late_interrupts(constants, tasks))
        for task, (limit_us, is_exact) in zip(
            tasks, worst_responses(constants, tasks), strict=True
        ):
            kinds.add((is_exact, limit_us and limit_us <= TICK_US * task.timing.period_ms))

    collect()
    assert kinds >= {(exact, ends) for exact in (False, True) for ends in (False, True)}
    assert late == (
        {(False, False), (True, False), (True, True)} if has_defect else {(False, False)}
    )


def test_a_worked_example():
    # Of the 3000 µs of the slow task, 1460 pass between 2530 and 4000, and 1460 until 8000.
    tasks = tasks_of((2, 4, 2500), (1, 20, 3000))
    assert worst_responses(kernel_constants(), tasks) == [(2530, True), (10_610, True)]
    assert simulated_responses(kernel_constants(), tasks, 20_000) == [(2530, 0), (10_610, 0)]


def test_a_job_that_takes_longer_than_its_period_loses_every_second_alarm():
    tasks = tasks_of((1, 4, 4200))
    assert worst_responses(kernel_constants(), tasks) == [(4250, True)]
    assert simulated_responses(kernel_constants(), tasks, 16_000) == [(4250, 2)]


def test_lost_alarms_of_a_higher_task_leave_more_time_than_the_analysis_says():
    # The middle one has 1980 until 4000, and then waits: its alarm of 4000 is lost.
    tasks = tasks_of((3, 4, 2000), (2, 4, 2000), (1, 100, 500))
    constants = kernel_constants(5)
    worst = worst_responses(constants, tasks)
    simulated = simulated_responses(constants, tasks, 100_000)
    assert worst == [(2015, True), (6035, True), (None, False)]
    assert simulated[1] == (6035, 12)
    assert simulated[2][0] < 100_000


def test_a_task_that_gets_nothing_has_no_limit():
    tasks = tasks_of((2, 2, 2000), (1, 10, 1))
    assert worst_responses(kernel_constants(0), tasks) == [(2000, True), (None, True)]
    assert simulated_responses(kernel_constants(0), tasks, 40_000) == [(2000, 0), (None, 3)]


def test_of_equal_tasks_the_first_does_not_wait_when_both_come_together():
    tasks = tasks_of((1, 4, 300), (1, 4, 500))
    assert worst_responses(kernel_constants(), tasks) == [(810, False), (810, True)]
    assert simulated_responses(kernel_constants(), tasks, 20_000) == [(310, 0), (810, 0)]


def test_a_task_that_runs_once_counts_once():
    tasks = tasks_of((2, 0, 900), (1, 4, 3500))
    assert worst_responses(kernel_constants(), tasks) == [(910, True), (4450, True)]


@pytest.mark.parametrize(
    ('time_us', 'interrupt_us', 'expected'),
    [
        (990, 10, (False, False)),
        (991, 10, (True, False)),
        (2989, 10, (True, False)),
        (2990, 10, (True, True)),
        (1299, 700, (True, True)),  # interrupts that wait catch up slowly
    ],
)
def test_the_defect_delays_interrupts_only_if_higher_tasks_take_long(
    time_us, interrupt_us, expected
):
    tasks = tasks_of((2, 4, time_us), (1, 20, 700))
    constants = kernel_constants(interrupt_us, has_defect=True)
    assert late_interrupts(constants, tasks) == expected
    assert late_interrupts(kernel_constants(interrupt_us), tasks) == (False, False)
    punctual = worst_responses(kernel_constants(interrupt_us), tasks)
    if expected == (False, False):
        assert worst_responses(constants, tasks) == punctual
    else:
        assert not any(is_exact for _, is_exact in worst_responses(constants, tasks))


def test_a_response_counts_from_the_millisecond_of_a_late_interrupt():
    # At 11 ms, the long one preempts the lowest until 14.21 ms, when the ticks of 12, 13 and 14 ms
    # are one: with it the short one comes, which ends at 14.32 ms.
    tasks = tasks_of((3, 3, 3200), (4, 2, 100), (1, 50, 9000))
    constants = kernel_constants(has_defect=True)
    assert simulated_responses(constants, tasks, 15_000)[1] == (320, 0)
    assert worst_responses(constants, tasks)[1] == (1119, False)
