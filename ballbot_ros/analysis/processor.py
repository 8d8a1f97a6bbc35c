"""How the tasks of the brick share its processor, from their jobs; times in µs."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ballbot_ros.analysis.run_data import Integers
from ballbot_ros.engine.scenario.task_timing import TICK_US, duty_rank, processor_share
from ballbot_ros.recording.messages.jobs import Jobs
from ballbot_ros.robot.arithmetic import Floats
from ballbot_ros.robot.brick.kernel import TICK_US as INTERRUPT_PERIOD_US

QUANTILES = (0.0, 0.5, 0.99, 1.0)
"""Shares of the jobs of a task up to which its times are given."""


def ended(jobs: Jobs) -> Jobs:
    """Return the jobs that have ended: those whose alarm was not lost."""
    return jobs.selected(~jobs.is_lost)


def sets_duty(jobs: Jobs) -> NDArray[np.bool_]:
    """Return whether each job may set the duty."""
    ranks = np.array([*map(duty_rank, jobs.tasks)])
    return np.asarray((ranks == ranks.max())[jobs.task])


def pieces(done: Jobs, interrupt_us: int) -> Integers:
    """Return when each of the ended jobs has the processor.

    A job loses it to those that begin and end meanwhile, and to the interrupts of `interrupt_us`,
    one a millisecond, which are assumed to come in time, as without the defect of the kernel. The
    rows, shape (3, n), are index of the job, start and end of each piece, by start.
    """
    whole = np.flatnonzero(done.preempted == 0)
    found = [np.stack([whole, done.start[whole], done.end[whole]])]
    for job in np.flatnonzero(done.preempted):
        start, end = done.start[job], done.end[job]
        # Jobs have the order of their ends, so those that ended meanwhile are next to each other.
        others = slice(np.searchsorted(done.end, start, 'right'), job)
        ticks = np.arange(start // INTERRUPT_PERIOD_US + 1, -(-end // INTERRUPT_PERIOD_US))
        ticks *= INTERRUPT_PERIOD_US
        taken = np.concatenate([done.start[others], ticks])
        free = np.concatenate([done.end[others], ticks + interrupt_us])
        order = np.argsort(taken)
        starts = np.maximum.accumulate(np.append(start, free[order]))
        piece = np.stack([np.full(len(starts), job), starts, np.append(taken[order], end)])
        found.append(piece[:, piece[1] < piece[2]])
    parts = np.concatenate(found, axis=1)
    return np.asarray(parts[:, np.argsort(parts[1], kind='stable')])


def utilisation(parts: Integers, edges: Integers, bus: float, interrupt_us: int) -> Floats:
    """Return the share of the processor between edges of time, from `pieces`; shape (n - 1,)."""
    _, start, end = parts
    busy = np.cumsum(end - start)
    totals = np.stack([busy - (end - start), busy])
    taken = np.diff(np.interp(edges, np.stack([start, end]).T.ravel(), totals.T.ravel()))
    return np.asarray(processor_share(bus, interrupt_us, taken / np.diff(edges) * TICK_US))


class TaskTimes(NamedTuple):
    """Numbers of jobs of a task, and their times at the :data:`QUANTILES`; NaN without jobs.

    `execution` is the time in which a job has the processor, `response` that from release to end.
    """

    task: str
    jobs: int
    lost: int
    execution: list[float]
    response: list[float]


def task_times(jobs: Jobs) -> list[TaskTimes]:
    """Return the times of each task."""
    found = []
    for number, name in enumerate(jobs.tasks):
        rows, lost = (jobs.task == number) & ~jobs.is_lost, (jobs.task == number) & jobs.is_lost
        response = (jobs.end - jobs.release)[rows]
        execution = (jobs.end - jobs.start - jobs.preempted)[rows]
        quantiles = _quantiles(execution), _quantiles(response)
        found.append(TaskTimes(name, int(rows.sum()), int(lost.sum()), *quantiles))
    return found


def _quantiles(values: Integers) -> list[float]:
    known = values if values.size else np.array([np.nan])
    return [float(each) for each in np.quantile(known, QUANTILES, method='inverted_cdf')]
