"""Judges of the kernel of the brick: the jobs of tasks, found by two other methods than its own.

Both return the jobs that end by a horizon, and the names of the tasks whose alarms are lost with
the times of these alarms. The first interrupt is at 0. `time_of(task, job)` is the time of a job by
the numbers of its task and of the job of this task. All times are in µs.
"""

import math

import numpy as np

from ballbot_ros.robot.brick.kernel import TICK_US, Job


def jobs_by_levels(tasks, offsets, interrupt_us, time_of, horizon_us):
    """Let the jobs of each priority take the microseconds that higher ones have left."""
    is_free = np.arange(horizon_us) % TICK_US >= interrupt_us
    jobs, lost = [], []
    for priority in sorted({task.priority for task in tasks}, reverse=True):
        level = [number for number, task in enumerate(tasks) if task.priority == priority]
        free = np.flatnonzero(is_free)
        used = 0
        counts, active_until = dict.fromkeys(level, 0), dict.fromkeys(level, 0)
        for alarm, number in alarms(tasks, offsets, level, horizon_us):
            name = tasks[number].name
            if active_until[number] > alarm:
                lost.append((name, alarm))
                continue
            time = time_of(number, counts[number])
            counts[number] += 1
            first = max(used, int(np.searchsorted(free, alarm)))
            used = first + time
            is_free[free[first:used]] = False
            if first >= len(free) or used > len(free):
                active_until[number] = math.inf
                continue
            start = int(free[first])
            end = int(free[used - 1]) + 1 if time else start
            # A job without time at a tick begins after the alarms of that tick.
            active_until[number] = end if time else end + 1
            jobs.append(Job(name, alarm, start, end, end - start - time))
    return jobs, lost


def alarms(tasks, offsets, numbers, horizon_us):
    """Return the alarms of some tasks in order, as pairs of their time and the task's number."""
    found = []
    for number in numbers:
        first, period = TICK_US * offsets[number], TICK_US * tasks[number].period_ms
        times = range(first, horizon_us, period) if period else [first]
        found += [(time, number) for time in times if time < horizon_us]
    return sorted(found)


class ReadyJob:
    """A job that is ready or running in :func:`jobs_by_steps`."""

    def __init__(self, task, priority, release):
        self.task, self.priority, self.release = task, priority, release
        self.start = None
        self.time = self.left = 0


def jobs_by_steps(tasks, offsets, interrupt_us, time_of, horizon_us, *, has_defect):
    """Step through the microseconds with a timer, the interrupt that it requests, and a queue."""
    jobs, lost = [], []
    counts, next_alarms = [0] * len(tasks), list(offsets)
    queue = []
    interrupts = interrupt_end = 0
    is_requested, unacknowledged = False, None

    def end(job, now):
        queue.remove(job)
        preempted = now - job.start - job.time
        jobs.append(Job(tasks[job.task].name, job.release, job.start, now, preempted))

    def activate(now):
        for number, (name, priority, period) in enumerate(tasks):
            if next_alarms[number] != interrupts:
                continue
            next_alarms[number] = interrupts + period if period else None
            if any(job.task == number for job in queue):
                lost.append((name, now))
            else:
                queue.append(ReadyJob(number, priority, now))
        # Jobs of one priority stay in their order, because sorting is stable.
        queue.sort(key=lambda job: -job.priority)

    for now in range(horizon_us):
        is_requested |= now % TICK_US == 0
        while now >= interrupt_end:
            running = queue[0] if queue else None
            if running is unacknowledged:
                unacknowledged = None
            if is_requested and unacknowledged is None:
                is_requested = False
                activate(now)
                interrupts += 1
                interrupt_end = now + interrupt_us
                if has_defect and running and running.start is not None and queue[0] is not running:
                    unacknowledged = running
                continue
            if running is None:
                break
            if running.start is None:
                running.start = now
                running.time = running.left = time_of(running.task, counts[running.task])
                counts[running.task] += 1
            if not running.left:
                end(running, now)
                continue
            running.left -= 1
            if not running.left:
                end(running, now + 1)
            break
    return jobs, lost
