"""How long the brick's jobs take from their alarm to their end, in the worst case and simulated.

The analysis is that of fixed priorities with preemption (Joseph and Pandya 1986, Audsley et al.
1993), for tasks whose alarms all start at 0. A response counts from the millisecond of the alarm's
interrupt, so an alarm is lost only if a response takes longer than the period.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from fractions import Fraction
from typing import NamedTuple

from ballbot_ros.robot.brick.kernel import HEAD, LOST, STRIDE, TICK_US, KernelConstants, OsekKernel
from ballbot_ros.robot.brick.schedule import TaskTiming


class TaskTime(NamedTuple):
    """A task, and the time of each of its jobs [µs]."""

    timing: TaskTiming
    time_us: int


def worst_responses(
    constants: KernelConstants, tasks: Sequence[TaskTime]
) -> list[tuple[int | None, bool]]:
    """Return a limit of the responses of each task [µs], and whether it is exact.

    The limit is the fixed point of R = C + sum ceil(R / T_j) C_j over the interrupt and the tasks
    of higher priorities; None if they may take all of the processor. C includes a job of each
    task that runs once, and one of each with the same priority, since none has two active jobs.

    It is the response of the first job, and so exact, unless a higher task may lose alarms, which
    takes load away; or an equal task with a higher number, which is activated later at the start,
    may come first at another tick; or the defect delays interrupts, see :func:`late_interrupts`. At
    most one comes in each millisecond, so C then grows by less than one.
    """
    is_late, is_alarm_late = late_interrupts(constants, tasks)
    found: dict[int, tuple[int | None, bool]] = {}
    for number in sorted(range(len(tasks)), key=lambda each: -tasks[each].timing.priority):
        timing, own_us = tasks[number]
        own_us += TICK_US - 1 if is_alarm_late and timing.period_ms else 0
        is_exact = not is_late
        repeated = [(TICK_US, constants.interrupt_us)]
        for other, (each, time_us) in enumerate(tasks):
            if other == number or each.priority < timing.priority:
                continue
            is_higher = each.priority > timing.priority
            if is_higher and each.period_ms:
                repeated.append((TICK_US * each.period_ms, time_us))
                is_exact &= (found[other][0] or math.inf) <= TICK_US * each.period_ms
            else:
                own_us += time_us
                is_exact &= is_higher or other < number
        found[number] = _fixed_point(own_us, repeated), is_exact
    return [found[number] for number in range(len(tasks))]


def _fixed_point(own_us: int, repeated: Sequence[tuple[int, int]]) -> int | None:
    """Return the smallest R = own + sum ceil(R / period) time; None if there is none."""
    free = 1 - sum(Fraction(time_us, period_us) for period_us, time_us in repeated)
    if free <= 0:
        return None
    response, previous = math.ceil(own_us / free), 0  # no fixed point is below
    while response != previous:
        previous = response
        response = own_us + sum(-(-previous // period) * time for period, time in repeated)
    return response


def late_interrupts(constants: KernelConstants, tasks: Sequence[TaskTime]) -> tuple[bool, bool]:
    """Return whether the defect may delay an interrupt, and one with alarms.

    An interrupt with alarms blocks further ones until all tasks above the interrupted one have run.
    Those that wait are then less and less late. The next alarms come after the greatest common
    divisor of the periods at the earliest.
    """
    lowest = min(task.timing.priority for task in tasks)
    higher_us = sum(task.time_us for task in tasks if task.timing.priority > lowest)
    blocked_us = constants.interrupt_us + higher_us
    if not constants.has_defect or blocked_us <= TICK_US:
        return False, False
    punctual = blocked_us // TICK_US + math.ceil(TICK_US / max(1, TICK_US - constants.interrupt_us))
    return True, punctual > math.gcd(*(task.timing.period_ms for task in tasks)) > 0


def simulated_responses(
    constants: KernelConstants, tasks: Sequence[TaskTime], until_us: int
) -> list[tuple[int | None, int]]:
    """Return the longest response of each task [µs], None if no job ended, and its lost alarms."""
    kernel = OsekKernel(constants, [task.timing for task in tasks])
    longest: list[int | None] = [None] * len(tasks)
    while (event := kernel.next_event(until_us)) >= 0:
        number, is_end = divmod(event, 2)
        if is_end:
            job = kernel.ended(number)
            response_us = job.end - job.release // TICK_US * TICK_US
            longest[number] = max(longest[number] or 0, response_us)
        else:
            kernel.take_time(number, tasks[number].time_us)
    return list(zip(longest, kernel.state[HEAD + LOST :: STRIDE], strict=True))
