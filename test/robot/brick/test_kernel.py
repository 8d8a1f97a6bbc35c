"""The kernel of the brick, compared with two other methods, with laws and with tables."""

import math
import random
from collections import Counter
from itertools import accumulate, pairwise

import pytest
from hypothesis import strategies as st
from kernel_judge import jobs_by_levels, jobs_by_steps
from laws import given

from ballbot_ros.robot.brick.kernel import (
    ACTIVATED,
    DUTY_X,
    DUTY_Y,
    HEAD,
    LEFT,
    NOW,
    RELEASE,
    STRIDE,
    TICK_US,
    Job,
    KernelConstants,
    OsekKernel,
    duty_effect,
    is_bus_busy,
    set_duty,
)
from ballbot_ros.robot.brick.schedule import Schedule, TaskTiming

WINDOW_US = 4000
FIRST_US = 1_234_567
"""A start that is no multiple of the tick."""

INTERRUPT_US, LINK_US, LATENCY_US = 10, 5, 230


def constants(interrupt_us=INTERRUPT_US, *, has_link=True, has_defect=False):
    return KernelConstants(interrupt_us, LINK_US, LATENCY_US, has_link, has_defect)


def even_windows(horizon_us, start_us=0):
    return range(start_us, start_us + horizon_us + 1, WINDOW_US)


def uneven_windows(draw, horizon_us, longest_us=9000):
    """Return the bounds of windows of any lengths, from 0 to a horizon."""
    lengths = [draw.choice((1, draw.randint(1, 1500), draw.randint(1, longest_us)))]
    while sum(lengths) < horizon_us:
        lengths.append(draw.choice((1, draw.randint(1, 1500), draw.randint(1, longest_us))))
    inner = [bound for bound in accumulate(lengths) if bound < horizon_us]
    return [0, *inner, horizon_us]


def run(kernel, time_of, windows, at_end=lambda task: None):
    """Run a kernel in windows; return the jobs that have ended, and the lost ones."""
    counts, jobs, lost = Counter(), [], []
    for begin, until in pairwise(windows):
        while (event := kernel.next_event(until)) >= 0:
            task, is_end = divmod(event, 2)
            if is_end:
                jobs.append(kernel.ended(task))
                at_end(task)
            else:
                kernel.take_time(task, time_of(task, counts[task]))
                counts[task] += 1
        lost += kernel.newly_lost(begin)
    return jobs, lost


def lost_jobs(lost, windows):
    """Return the lost jobs for pairs of task and alarm: theirs is the time of the window."""
    starts = [(name, max(begin for begin in windows if begin <= at)) for name, at in lost]
    return [Job(name, begin, begin, begin, is_lost=True) for name, begin in starts]


def moved(jobs, by_us):
    return [
        job._replace(release=job.release + by_us, start=job.start + by_us, end=job.end + by_us)
        for job in jobs
    ]


class TaskSet:
    """Tasks at random, many of which take more time than there is."""

    def __init__(self, draw, longest_us=3000):
        count = draw.randint(1, 8)
        priorities = draw.choice((2, 4, 100))
        periods = draw.choice(((0, *range(1, 21)), (0, 1, 2, 3), (4, 8, 20), (6, 10, 15, 20)))
        self.tasks = [
            TaskTiming(f'task {number}', draw.randint(1, priorities), draw.choice(periods))
            for number in range(count)
        ]
        self.offsets = [draw.choice((0, 0, draw.randint(0, 12))) for _ in self.tasks]
        self.interrupt_us = draw.choice((0, 1, 10, draw.randint(0, 300)))
        load = draw.choice((0.0, 0.3, 1.0, 1.0))
        longest = [draw.choice((0, 1, 990, *5 * [draw.randint(0, longest_us)])) for _ in self.tasks]
        self.times = [
            [draw.choice((0, *3 * [round(load * most)], draw.randint(0, most))) for _ in range(64)]
            for most in longest
        ]

    def time_of(self, task, job):
        return self.times[task][job % 64]

    def kernel(self, *, start_us=0, has_defect=False):
        return OsekKernel(
            constants(self.interrupt_us, has_defect=has_defect),
            self.tasks,
            start_us,
            offsets=self.offsets,
        )

    def judged(self, judge, horizon_us, **options):
        return judge(
            self.tasks, self.offsets, self.interrupt_us, self.time_of, horizon_us, **options
        )


def is_as_judged(task_set, judged, windows, *, start_us=0, has_defect=False):
    """Return whether the kernel finds the jobs of a judge in these windows."""
    kernel = task_set.kernel(start_us=start_us, has_defect=has_defect)
    found = run(kernel, task_set.time_of, [start_us + bound for bound in windows])
    jobs, lost = judged
    expected = jobs, lost_jobs(lost, windows)
    assert all(one.end <= other.end for one, other in pairwise(found[0]))
    for one, other in zip(expected, found, strict=True):
        assert sorted(moved(one, start_us)) == sorted(other)
    return True


@pytest.mark.parametrize('part', range(8))
def test_the_jobs_are_those_of_the_free_time_of_each_priority(part):
    draw, horizon_us = random.Random(part), 60_000
    lost = preempted = 0
    for _ in range(40):
        task_set = TaskSet(draw)
        judged = task_set.judged(jobs_by_levels, horizon_us)
        assert is_as_judged(task_set, judged, even_windows(horizon_us))
        uneven = uneven_windows(draw, horizon_us)
        assert is_as_judged(task_set, judged, uneven, start_us=FIRST_US)
        lost += len(judged[1])
        preempted += sum(job.preempted > task_set.interrupt_us for job in judged[0])
    assert min(lost, preempted) > 50


@pytest.mark.parametrize('has_defect', [False, True])
def test_the_jobs_are_those_of_stepping_through_the_microseconds(has_defect):
    draw, horizon_us = random.Random(7), 20_000
    unlike = 0
    for _ in range(200):
        task_set = TaskSet(draw, 2500)
        judged = task_set.judged(jobs_by_steps, horizon_us, has_defect=has_defect)
        unlike += sorted(judged[0]) != sorted(task_set.judged(jobs_by_levels, horizon_us)[0])
        assert is_as_judged(task_set, judged, even_windows(horizon_us), has_defect=has_defect)
        uneven = uneven_windows(draw, horizon_us)
        assert is_as_judged(task_set, judged, uneven, start_us=FIRST_US, has_defect=has_defect)
    assert unlike > 20 if has_defect else unlike == 0


# Laws.

SLOT_US = 50
"""All times of a task set are multiples of it, so that nothing begins or ends within a slot."""

slots = st.integers(0, 40).map(lambda number: SLOT_US * number)
task_rows = st.lists(
    st.tuples(st.integers(1, 4), st.integers(0, 6), st.integers(0, 5), st.lists(slots, min_size=1)),
    min_size=1,
    max_size=6,
)


def tasks_of(rows):
    return [
        TaskTiming(str(number), priority, period)
        for number, (priority, period, *_) in enumerate(rows)
    ]


def numbers(kernel, place):
    return kernel.state[HEAD + place :: STRIDE]


@given(task_rows, st.sampled_from([0, 50, 300]))
def test_in_each_slot_the_first_job_of_the_highest_priority_runs(rows, interrupt_us):
    tasks = tasks_of(rows)
    kernel = OsekKernel(constants(interrupt_us), tasks, offsets=[row[2] for row in rows])
    begun, counts = [0] * len(rows), Counter()

    def time_of(task, job):
        time = rows[task][3][job % len(rows[task][3])]
        begun[task] += time
        return time

    worked = [0] * len(rows)
    for slot in range(0, 12_000, SLOT_US):
        while (event := kernel.next_event(slot + SLOT_US)) >= 0:
            task, is_end = divmod(event, 2)
            if not is_end:
                kernel.take_time(task, time_of(task, counts[task]))
                counts[task] += 1
        before, left = worked, numbers(kernel, LEFT)
        worked = [all_begun - each for all_begun, each in zip(begun, left, strict=True)]
        spent = [now - earlier for now, earlier in zip(worked, before, strict=True)]
        if slot % TICK_US < interrupt_us:
            assert sum(spent) == 0
            continue
        releases = numbers(kernel, RELEASE)
        waiting = [number for number, active in enumerate(numbers(kernel, ACTIVATED)) if active]
        running = [number for number, time in enumerate(spent) if time]
        assert sum(spent) == (SLOT_US if running else 0)
        assert len(running) == 1 or not (running or waiting)
        order = [(-tasks[each].priority, releases[each], each) for each in [*running, *waiting]]
        assert order[:1] == sorted(order)[:1]


@given(task_rows)
def test_without_times_all_happens_at_the_release_in_the_order_of_priorities(rows):
    tasks = tasks_of(rows)
    kernel = OsekKernel(constants(0), tasks)
    jobs, lost = run(kernel, lambda task, job: 0, even_windows(24_000))
    assert not lost
    assert jobs == [
        Job(name, at, at, at)
        for at in range(0, 24_000, TICK_US)
        for name in Schedule(tasks).due(at // TICK_US)
    ]


@st.composite
def distinct_priorities(draw):
    """Return tasks, the highest priority first, with their longest times, and an interrupt."""
    count = draw(st.integers(1, 6))
    periods = draw(st.lists(st.integers(1, 20), min_size=count, max_size=count))
    times = [draw(st.integers(1, 2000 * period // (count + 1))) for period in periods]
    order = draw(st.permutations(range(count)))
    rows = [(TaskTiming(str(each), count - each, periods[each]), times[each]) for each in order]
    return rows, draw(st.integers(0, 300))


def response_times(rows, interrupt_us):
    """Return the longest response times by task, of those that end before their next alarm.

    This is the fixed point of R = C + sum ceil(R / T_j) C_j over the interrupt and the tasks of
    higher priorities. A job that ends at a tick is not interrupted by it.
    """
    found, higher = {}, [(TICK_US, interrupt_us)]
    for timing, time in sorted(rows, key=lambda row: -row[0].priority):
        period = TICK_US * timing.period_ms
        response, previous = time, 0
        while previous < response <= period:
            previous = response
            response = time + sum(math.ceil(previous / each) * cost for each, cost in higher)
        if response > period:
            break
        found[timing.name] = response
        higher.append((period, time))
    return found


def test_response_times_of_an_example():
    # Of the 3000 of ts2, 1460 pass between 2530 and 4000, and 1460 between 6530 and 8000.
    rows = [(TaskTiming('ts1', 2, 4), 2500), (TaskTiming('ts2', 1, 20), 3000)]
    assert response_times(rows, 10) == {'ts1': 2530, 'ts2': 10_610}


@given(distinct_priorities(), st.lists(st.integers(0, 20), min_size=6, max_size=6), st.data())
def test_no_response_time_exceeds_the_analysis(drawn, offsets, data):
    rows, interrupt_us = drawn
    limits = response_times(rows, interrupt_us)
    shares = data.draw(st.lists(st.sampled_from([0.0, 0.5, 1.0, 1.0]), min_size=7, max_size=7))
    kernel = OsekKernel(
        constants(interrupt_us), [timing for timing, _ in rows], offsets=offsets[: len(rows)]
    )
    jobs, lost = run(
        kernel,
        lambda task, job: math.ceil(shares[(task + job) % 7] * rows[task][1]),
        even_windows(80_000),
    )
    assert not {job.task for job in lost} & set(limits)
    for job in jobs:
        assert job.end - job.release <= limits.get(job.task, math.inf)


@given(distinct_priorities())
def test_the_response_times_of_the_analysis_occur_when_all_alarms_come_together(drawn):
    rows, interrupt_us = drawn
    kernel = OsekKernel(constants(interrupt_us), [timing for timing, _ in rows])
    jobs, _ = run(kernel, lambda task, job: rows[task][1], even_windows(24_000))
    longest = {}
    for job in jobs:
        longest[job.task] = max(longest.get(job.task, 0), job.end - job.release)
    limits = response_times(rows, interrupt_us)
    assert {task: longest[task] for task in limits} == limits


# A task that has preempted another one blocks the interrupt.

LOW, HIGH, TOP = (TaskTiming(name, number, 0) for number, name in enumerate(('low', 'high', 'top')))
EQUAL = TaskTiming('equal', LOW.priority, 0)
"""Tasks that run once; their offsets are in the tests."""

DEFECT_TABLES = {
    # The tick at 2000 waits for low, so top does not preempt high.
    'it waits until the preempted task goes on': (
        [(LOW, 0, 5000), (HIGH, 1, 1500), (TOP, 2, 100)],
        [('high', 1000, 1010, 2510), ('top', 2510, 2520, 2620), ('low', 0, 10, 6670)],
    ),
    # Those at 2000, 3000 and 4000 are one, at 4410; the next one, at 5000, counts as the third.
    'several that wait are one': (
        [(LOW, 0, 3000), (HIGH, 1, 3400), (TOP, 3, 100)],
        [('high', 1000, 1010, 4410), ('top', 5000, 5010, 5110), ('low', 0, 10, 6550)],
    ),
    # High and equal both wait before low, so the tick at 2000 comes after both, at 4010.
    'it waits for all tasks that are higher': (
        [(LOW, 0, 1500), (HIGH, 1, 1000), (TOP, 1, 2000), (EQUAL, 2, 100)],
        [
            ('top', 1000, 1010, 3010),
            ('high', 1000, 3010, 4010),
            ('low', 0, 10, 4530),
            ('equal', 4010, 4530, 4630),
        ],
    ),
    # High has preempted nothing; top preempts high from 2010 to 2110.
    'one that meets the idle processor does not block': (
        [(LOW, 0, 500), (HIGH, 1, 1500), (TOP, 2, 100)],
        [('low', 0, 10, 510), ('top', 2000, 2010, 2110), ('high', 1000, 1010, 2620)],
    ),
    # At 1000, top has just ended, and low has not begun.
    'one that meets a task that has not begun does not block': (
        [(LOW, 0, 100), (TOP, 0, 990), (HIGH, 1, 1500), (TOP._replace(name='late'), 2, 100)],
        [
            ('top', 0, 10, 1000),
            ('late', 2000, 2010, 2110),
            ('high', 1000, 1010, 2620),
            ('low', 0, 2620, 2720),
        ],
    ),
    # Equal does not preempt low.
    'one that activates an equal task does not block': (
        [(LOW, 0, 2500), (EQUAL, 1, 100), (TOP, 2, 100)],
        [('top', 2000, 2010, 2110), ('low', 0, 10, 2630), ('equal', 1000, 2630, 2730)],
    ),
    # Low has ended at 1000, when high comes.
    'one at the end of a task does not block': (
        [(LOW, 0, 990), (HIGH, 1, 1500), (TOP, 2, 100)],
        [('low', 0, 10, 1000), ('top', 2000, 2010, 2110), ('high', 1000, 1010, 2620)],
    ),
    # Top comes at 3510 instead of 2000, and preempts low again: the tick at 4000 is on time,
    # because low goes on from 3620.
    'one that has waited may block again': (
        [(LOW, 0, 2000), (HIGH, 1, 2500), (TOP, 2, 100), (TOP._replace(name='late'), 3, 100)],
        [
            ('high', 1000, 1010, 3510),
            ('top', 3510, 3520, 3620),
            ('late', 4000, 4010, 4110),
            ('low', 0, 10, 4740),
        ],
    ),
}


def once(rows, *, has_defect, windows, sends=True, at_end=lambda kernel, task: None):
    """Run tasks that are given by timing, offset and time; return the jobs as in the tables."""
    kernel = OsekKernel(
        constants(has_defect=has_defect),
        [timing for timing, _, _ in rows],
        sends=sends,
        offsets=[offset for _, offset, _ in rows],
    )
    jobs, lost = run(
        kernel, lambda task, job: rows[task][2], windows, lambda task: at_end(kernel, task)
    )
    assert not lost
    times = {timing.name: time for timing, _, time in rows}
    assert all(job.preempted == job.end - job.start - times[job.task] for job in jobs)
    return kernel, [job[:4] for job in jobs]


@pytest.mark.parametrize('windows', [even_windows(8000), range(0, 8001, 10), (0, 2515, 8000)])
@pytest.mark.parametrize('case', DEFECT_TABLES)
def test_the_interrupt_waits_as_in_the_tables(case, windows):
    rows, expected = DEFECT_TABLES[case]
    assert once(rows, has_defect=True, windows=windows)[1] == expected


def test_without_the_defect_the_interrupt_does_not_wait():
    rows, _ = DEFECT_TABLES['it waits until the preempted task goes on']
    assert once(rows, has_defect=False, windows=even_windows(8000))[1] == [
        ('top', 2000, 2010, 2110),
        ('high', 1000, 1010, 2620),
        ('low', 0, 10, 6670),
    ]


def test_alarms_of_merged_interrupts_come_later_and_none_is_lost():
    tasks = [LOW, HIGH, TaskTiming('fast', 3, 1)]
    kernel = OsekKernel(constants(has_defect=True), tasks, offsets=[0, 1, 1])
    times = 3000, 3400, 100
    jobs, lost = run(kernel, lambda task, job: times[task], even_windows(8000))
    releases = [job.release for job in jobs if job.task == 'fast']
    # The second one waits for low, before which high runs from 1110 on; with it are those of 3000
    # and 4000.
    assert releases == [1000, 4510, 5000, 6000, 7000]
    assert not lost


# Duties.


class DutyRun:
    """A task of 4 ms whose jobs set a duty at their ends."""

    def __init__(self, time_us, duties, *, sends=True, has_link=True):
        self.constants = constants(has_link=has_link)
        self.kernel = OsekKernel(self.constants, [TaskTiming('ts1', 1, 4)], sends=sends)
        self.time_us, self.duties, self.until_us = time_us, iter(duties), 0

    def window(self):
        """Run for 4 ms; return when the newest duty takes effect, and this duty."""
        bounds = self.until_us, self.until_us + WINDOW_US
        self.until_us = bounds[1]
        run(self.kernel, lambda task, job: self.time_us, bounds, self.set)
        state = self.kernel.state
        effect = duty_effect(self.constants, state)
        assert duty_effect(self.constants, state) == effect
        return effect, (state[DUTY_X], state[DUTY_Y])

    def set(self, task):
        set_duty(self.kernel.state, *next(self.duties))


@pytest.mark.parametrize(
    ('sends', 'time_us', 'leaves_us'),
    [
        (True, 0, 2000),
        (True, 500, 2000),
        (True, 1980, 2000),  # it ends at 2000, before the interrupt
        (True, 1981, 4000),
        (True, 3960, 4000),
        (False, 0, 1000),
        (False, 990, 1000),
        (False, 991, 3000),
        (False, 2970, 3000),
        (False, 2971, 5000),
    ],
)
def test_a_duty_leaves_with_the_next_frame(sends, time_us, leaves_us):
    duties = [(number, -number) for number in (1, 2, 3)]
    duty_run = DutyRun(time_us, duties, sends=sends)
    for number, duty in enumerate(duties):
        expected = WINDOW_US * number + leaves_us + LINK_US + LATENCY_US
        assert duty_run.window() == (expected, duty)


@pytest.mark.parametrize('sends', [False, True])
@pytest.mark.parametrize('time_us', [0, 500, 2500, 3960])
def test_the_effect_does_not_change_when_the_link_has_taken_the_duty(sends, time_us):
    duty_run = DutyRun(time_us, [(5, 6)] * 5, sends=sends)
    first = duty_run.window()
    assert first[0] > time_us
    assert [duty_run.window() for _ in range(4)] == [first] * 4


@pytest.mark.parametrize('change', [(7, 6), (5, 7)])
def test_a_duty_that_differs_on_one_axis_is_new(change):
    duty_run = DutyRun(500, [(5, 6), change])
    assert duty_run.window() == (2235, (5, 6))
    assert duty_run.window() == (6235, change)


def test_without_a_duty_none_takes_effect():
    duty_run = DutyRun(500, [(0, 0)] * 3)
    assert [duty_run.window() for _ in range(3)] == [(0, (0, 0))] * 3


@pytest.mark.parametrize('sends', [False, True])
def test_without_a_link_a_duty_acts_when_it_is_set(sends):
    duty_run = DutyRun(500, [(5, 6), (5, 6), (7, 8)], sends=sends, has_link=False)
    assert duty_run.window() == (510, (5, 6))
    assert duty_run.window() == (510, (5, 6))
    assert duty_run.window() == (8510, (7, 8))


def test_the_link_takes_the_newest_duty():
    # The first one is set at 210; the second one at 510 or, behind the frame of 2000, at 2220.
    tasks = [TaskTiming('one', 2, 0), TaskTiming('other', 1, 0)]
    for time_us, leaves_us in ((300, 2000), (1990, 4000)):
        kernel = OsekKernel(constants(), tasks)
        times = 200, time_us
        run(
            kernel,
            lambda task, job, times=times: times[task],
            (0, 3000),
            lambda task, kernel=kernel: set_duty(kernel.state, 1 + task, 0),
        )
        assert duty_effect(constants(), kernel.state) == leaves_us + LINK_US + LATENCY_US
        assert kernel.state[DUTY_X] == 2


@pytest.mark.parametrize(('has_defect', 'leaves_us'), [(False, 4000), (True, 2510)])
def test_with_the_defect_the_link_waits_too(has_defect, leaves_us):
    def set_one(kernel, task):
        if rows[task][0] == HIGH:
            set_duty(kernel.state, 1, 2)

    rows = [(LOW, 0, 5000), (HIGH, 1, 1500)]
    kernel, jobs = once(rows, has_defect=has_defect, windows=(0, 8000), at_end=set_one)
    assert jobs[0] == ('high', 1000, 1010, 2510 if has_defect else 2520)
    assert duty_effect(kernel.constants, kernel.state) == leaves_us + LINK_US + LATENCY_US


# The rest.


def test_the_bus_is_busy_until_a_reading_ends():
    kernel, asked = OsekKernel(constants(), [TaskTiming('ts2', 1, 1)]), []

    def ask(task):
        asked.append(is_bus_busy(kernel.state, 3000))

    run(kernel, lambda task, job: 100 if job != 6 else 99, (0, 8000), ask)
    # From 110 to 3110, when it is free again, and from then to 6110: 6109 is too early.
    assert asked == [False, True, True, False, True, True, True, False]


def test_a_copy_goes_on_by_itself():
    draw, horizon_us = random.Random(3), 40_000
    for _ in range(20):
        task_set = TaskSet(draw)
        kernel = task_set.kernel()
        run(kernel, lambda task, job: 700, (0, 8000))
        twin = kernel.copy()
        before = list(kernel.state)
        expected = run(twin, lambda task, job: 600, (8000, 16_000, horizon_us))
        assert kernel.state == before
        assert run(kernel, lambda task, job: 600, (8000, 16_000, horizon_us)) == expected
        assert kernel.state == twin.state


def test_a_blocked_link_lets_no_duty_act_before_it_is_set():
    """At the end of the window the interrupt still waits; the next window says when it came."""
    constants = KernelConstants(10, 5, 230, has_link=True, has_defect=True)
    tasks = [
        TaskTiming(name, priority, 0) for priority, name in enumerate(('low', 'mid', 'top'), 1)
    ]
    kernel = OsekKernel(constants, tasks, offsets=(0, 1, 1))
    set_us, effects = 0, []
    for until_us in (4000, 8000):
        while (event := kernel.next_event(until_us)) >= 0:
            if event % 2 == 0:
                kernel.take_time(event // 2, (3500, 2500, 2000)[event // 2])
            elif event // 2 == 2:
                set_duty(kernel.state, 1, 0)
                set_us = kernel.state[NOW]
        effects.append(duty_effect(constants, kernel.state))
    assert set_us == 3010
    assert set_us < effects[0] <= effects[1]


def test_bus_and_effect_begin_with_the_run():
    kernel = OsekKernel(KernelConstants(0, 0, 0, has_link=False, has_defect=False), (), 7_000)
    assert duty_effect(kernel.constants, kernel.state) == 7_000
    assert not is_bus_busy(kernel.state, 300)
    assert is_bus_busy(kernel.state, 300)
