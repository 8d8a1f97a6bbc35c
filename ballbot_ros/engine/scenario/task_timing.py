"""How the brick kept its times, tick by tick: what the metrics of its tasks are computed from."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ballbot_ros.controllers.controller import IDLE, TICK
from ballbot_ros.controllers.document.axis import TASK_TS1
from ballbot_ros.parameters.timing import TICK_MS, TICK_NS
from ballbot_ros.robot.arithmetic import Floats
from ballbot_ros.robot.brick.job_times import bus_share, is_timed, kernel_constants
from ballbot_ros.robot.brick.kernel import NOT_YET, Job

TICK_US = TICK_NS // 1000

RESPONSE_US, LOST, SHARE, DUTY_AGE_US = range(4)
COUNT = 4
"""Columns of the timing of a tick: the longest time from release to end of a job that sets the duty
and ended in the tick, or NOT_YET; the alarms lost, of all tasks; :func:`processor_share`; and
:func:`duty_age`, or NOT_YET if the duty is that of the tick before.
"""


def processor_share(bus: float, interrupt_us: int, jobs_us: Any) -> Any:
    """Return the share of the processor that a tick takes, with all of its interrupts.

    `bus` is the share of the bus's, and `jobs_us` the time of the jobs that ended in the tick.
    """
    return bus + (1.0 - bus) * (jobs_us + TICK_MS * interrupt_us) / TICK_US


def duty_age(effect_us: Any, start_us: Any) -> Any:
    """Return the time [µs] from the tick in which a job started until its duty acts.

    The job has the samples of that tick. Of several that end in a tick, the last one counts.
    """
    return effect_us - start_us // TICK_US * TICK_US


def duty_rank(task: str) -> int:
    """Return a number that is greatest for the tasks of a controller that set its duty.

    All but the idle one do so if it has tasks of its own.
    """
    return 2 if task in (TASK_TS1, TICK) else 0 if task == IDLE else 1


def job_row(job: Job) -> tuple[int, ...]:
    """Return the :func:`duty_rank` of the task of a job, and its other fields."""
    return (duty_rank(job.task), *job[1:])


def task_timing(
    p: Any,
    jobs: NDArray[np.int64],
    stamps_ns: NDArray[np.int64],
    duty: NDArray[Any],
    delay_ns: NDArray[np.int64],
) -> Floats:
    """Return the timing of ticks, shape (n, 4); without rows if the brick takes no time.

    Parameters
    ----------
    p : ControllerParameters
    jobs : ndarray, shape (m, 6)
        A :func:`job_row` each, in the order of their ends.
    stamps_ns, duty, delay_ns : ndarray, shape (n,), (n, 2), (n,)
        The ticks, their duties, and when these act.
    """
    count = len(stamps_ns) if is_timed(p) else 0
    timing, stamps_us = np.zeros((count, COUNT)), stamps_ns // 1000
    if not count:
        return timing
    # A job may end at the very end of its tick, or take no time.
    ends_in = np.maximum(jobs[:, 2] // TICK_US, (jobs[:, 3] - 1) // TICK_US) * TICK_US
    at = np.searchsorted(stamps_us, ends_in).clip(max=count - 1)
    is_known = stamps_us[at] == ends_in
    rank, release, start, end, preempted, is_lost = jobs[is_known].T
    at, ended = at[is_known], is_lost == 0
    jobs_us = np.bincount(at[ended], (end - start - preempted)[ended], count)
    timing[:, LOST] = np.bincount(at[~ended], minlength=count)
    timing[:, SHARE] = processor_share(bus_share(p), kernel_constants(p).interrupt_us, jobs_us)
    timing[:, [RESPONSE_US, DUTY_AGE_US]] = NOT_YET
    ended &= rank == rank.max(initial=0)
    np.maximum.at(timing[:, RESPONSE_US], at[ended], (end - release)[ended])
    starts_us = np.full(count, NOT_YET)
    starts_us[at[ended]] = start[ended]  # of several, the last
    is_new = np.diff(duty, axis=0, prepend=duty.dtype.type(0)).any(axis=1) & (starts_us >= 0)
    timing[is_new, DUTY_AGE_US] = duty_age(stamps_us + delay_ns // 1000, starts_us)[is_new]
    return timing
