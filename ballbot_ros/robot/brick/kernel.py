"""The kernel of the brick: which task has the processor at each microsecond.

The rules are those of OSEK OS 2.2.1, conformance class ECC2, as generated for nxtOSEK. A task with
a higher priority preempts one with a lower; of equal ones, the first that was activated runs first,
and a preempted task is at the front of its queue. An interrupt every millisecond activates the
tasks whose alarms expire and lets the link exchange its frames; tasks are dispatched after it. An
alarm of a task that is still active is lost (E_OS_LIMIT), and the next one keeps its phase.

The state is a list of whole numbers, so that compiled code works on it, too. Times are in µs.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from copy import copy
from typing import NamedTuple

from ballbot_ros.robot.arithmetic import Ints
from ballbot_ros.robot.brick.schedule import TaskTiming
from ballbot_ros.robot.compiler_hints import inlined

TICK_US = 1000
"""Period of the interrupt."""

NOT_YET = NO_TASK = -1
NEVER = 2**62

NOW, TICKS, NEXT_TICK, NEXT_ALARM, ACTIVATIONS, ACTIVE, BLOCKER = range(7)
LINK_SENDS, DUTY_SET, DUTY_SENT, BUS_FREE, EFFECT, DUTY_X, DUTY_Y, NEXT_X, NEXT_Y = range(7, 16)
HEAD = 16
"""Places of the kernel's own numbers: the time; interrupts so far; when the next one is due, and
which is the next one with an alarm; number of activations, and of active tasks; the interrupted
task that the defect waits for, or NO_TASK; whether the next interrupt sends; when the duty was set
that waits for the link, and when the link has taken it, or NOT_YET; when the sonar's bus is free;
when the newest duty takes effect; that duty; the duty of the job that has begun, if nothing else
keeps it.
"""

PRIORITY, PERIOD, ALARM, ACTIVATED, RELEASE, START, TIME, LEFT, LOST = range(9)
STRIDE = 9
"""Places of a task's numbers: its priority, its period [ticks] (0: once) and the tick of its next
alarm; the number of its activation, 0 while it is suspended; release and start of its job (start is
NOT_YET before it begins); the time that the job takes, and what is left of it; and the alarms lost
that :func:`next_lost` has not told yet.
"""


class KernelConstants(NamedTuple):
    """What does not change in a run.

    Attributes
    ----------
    interrupt_us : int
        Time of the interrupt.
    link_us : int
        Time from its beginning until the link takes the duties.
    latency_us : int
        Time from then until a duty acts.
    has_link : bool
        Whether duties pass the link; otherwise they act when they are set.
    has_defect : bool
        Whether a task that has preempted another one blocks the interrupt until it ends, as in
        nxtOSEK: the interrupt is acknowledged only when the interrupted task goes on. One interrupt
        waits meanwhile, further ones are lost.
    """

    interrupt_us: int
    link_us: int
    latency_us: int
    has_link: bool
    has_defect: bool


def kernel_size(tasks: int) -> int:
    """Return how many numbers the state of a kernel with so many tasks has."""
    return HEAD + STRIDE * tasks


def start_kernel(kernel: Ints, start_us: int, sends: bool) -> None:
    """Let a kernel begin whose tasks have been set by :func:`set_task`.

    `sends` is whether the first interrupt sends.
    """
    for place in range(HEAD):
        kernel[place] = 0
    kernel[NOW] = kernel[NEXT_TICK] = kernel[EFFECT] = kernel[BUS_FREE] = start_us
    kernel[NEXT_ALARM] = NEVER
    for task in range((len(kernel) - HEAD) // STRIDE):
        kernel[NEXT_ALARM] = min(kernel[NEXT_ALARM], kernel[HEAD + STRIDE * task + ALARM])
    kernel[BLOCKER] = kernel[DUTY_SET] = kernel[DUTY_SENT] = NOT_YET
    kernel[LINK_SENDS] = 1 if sends else 0


def set_task(kernel: Ints, task: int, priority: int, period: int, offset: int = 0) -> None:
    """Set a task's priority, and the period and the first of its alarms [ticks]."""
    at = HEAD + STRIDE * task
    for place in range(STRIDE):
        kernel[at + place] = 0
    kernel[at + PRIORITY], kernel[at + PERIOD], kernel[at + ALARM] = priority, period, offset


@inlined
def next_event(constants: KernelConstants, kernel: Ints, until_us: int) -> int:
    """Let time pass until a job begins or ends, or to a time.

    Return twice the number of the task whose job begins, or that plus one if it ends; -1 at the
    time. After a beginning, :func:`take_time` has to say how long the job takes.
    """
    tasks = (len(kernel) - HEAD) // STRIDE
    while True:
        now, tick, blocker = kernel[NOW], kernel[NEXT_TICK], kernel[BLOCKER]
        if now >= until_us:
            return -1
        if tick <= now and blocker < 0:
            interrupt(constants, kernel, tasks)
            continue
        if not kernel[ACTIVE]:
            pass_idle_time(constants, kernel, until_us)
            kernel[NOW] = min(kernel[NEXT_TICK], until_us)
            continue
        running = highest_task(kernel, tasks)
        if running == blocker:
            # It goes on, so the interrupt is acknowledged; one that waits happens first.
            kernel[BLOCKER] = NOT_YET
            continue
        at = HEAD + STRIDE * running
        if kernel[at + START] < 0:
            kernel[at + START] = now
            return 2 * running
        limit = until_us if blocker >= 0 else min(tick, until_us)
        spent = min(kernel[at + LEFT], limit - now)
        kernel[at + LEFT] -= spent
        kernel[NOW] = now + spent
        if not kernel[at + LEFT]:
            kernel[at + ACTIVATED] = 0
            kernel[ACTIVE] -= 1
            return 2 * running + 1


@inlined
def pass_idle_time(constants: KernelConstants, kernel: Ints, until_us: int) -> None:
    """Carry out the interrupts at which no alarm expires, while no task is active."""
    due = -(-(until_us - kernel[NEXT_TICK]) // TICK_US)
    ticks = min(due, kernel[NEXT_ALARM] - kernel[TICKS])
    if ticks <= 0:
        return
    first = 0 if kernel[LINK_SENDS] else 1
    if constants.has_link and kernel[DUTY_SET] >= 0 and first < ticks:
        kernel[DUTY_SENT] = kernel[NEXT_TICK] + first * TICK_US + constants.link_us
        kernel[DUTY_SET] = NOT_YET
    kernel[LINK_SENDS] = (kernel[LINK_SENDS] + ticks) % 2
    kernel[TICKS] += ticks
    kernel[NEXT_TICK] += ticks * TICK_US


@inlined
def take_time(kernel: Ints, task: int, time_us: int) -> None:
    """Say how long the job takes that has just begun."""
    at = HEAD + STRIDE * task
    kernel[at + TIME] = kernel[at + LEFT] = time_us


@inlined
def highest_task(kernel: Ints, tasks: int) -> int:
    """Return the active task that has the processor, or NO_TASK."""
    chosen, highest, first = NO_TASK, 0, 0
    for task in range(tasks):
        at = HEAD + STRIDE * task
        activated = kernel[at + ACTIVATED]
        if not activated:
            continue
        priority = kernel[at + PRIORITY]
        if chosen < 0 or priority > highest or (priority == highest and activated < first):
            chosen, highest, first = task, priority, activated
    return chosen


@inlined
def interrupt(constants: KernelConstants, kernel: Ints, tasks: int) -> None:
    """Carry out the interrupt that is due: activate tasks, let the link take the duties."""
    now = kernel[NOW]
    # Of those that have come while it was blocked, one has been kept.
    kernel[NEXT_TICK] += ((now - kernel[NEXT_TICK]) // TICK_US + 1) * TICK_US
    interrupted = highest_task(kernel, tasks) if constants.has_defect else NO_TASK
    if kernel[TICKS] == kernel[NEXT_ALARM]:
        activate_tasks(kernel, tasks)
    kernel[TICKS] += 1
    if constants.has_link and kernel[LINK_SENDS] and kernel[DUTY_SET] >= 0:
        kernel[DUTY_SENT], kernel[DUTY_SET] = now + constants.link_us, NOT_YET
    kernel[LINK_SENDS] = 1 - kernel[LINK_SENDS]
    kernel[NOW] = now + constants.interrupt_us
    if (
        interrupted >= 0
        and kernel[HEAD + STRIDE * interrupted + START] >= 0
        and highest_task(kernel, tasks) != interrupted
    ):
        kernel[BLOCKER] = interrupted


@inlined
def activate_tasks(kernel: Ints, tasks: int) -> None:
    """Activate the tasks whose alarms expire at this interrupt."""
    tick, next_alarm = kernel[TICKS], NEVER
    for task in range(tasks):
        at = HEAD + STRIDE * task
        if kernel[at + ALARM] == tick:
            kernel[at + ALARM] = tick + kernel[at + PERIOD] if kernel[at + PERIOD] else NEVER
            if kernel[at + ACTIVATED]:
                kernel[at + LOST] += 1
            else:
                kernel[ACTIVE] += 1
                kernel[ACTIVATIONS] += 1
                kernel[at + ACTIVATED] = kernel[ACTIVATIONS]
                kernel[at + RELEASE], kernel[at + START] = kernel[NOW], NOT_YET
        next_alarm = min(next_alarm, kernel[at + ALARM])
    kernel[NEXT_ALARM] = next_alarm


JobNumbers = tuple[int, int, int, int, int, int]
"""The fields of a :class:`Job`, with the number of its task."""


@inlined
def ended_job(kernel: Ints, task: int) -> JobNumbers:
    """Return the job of a task that has just ended."""
    at = HEAD + STRIDE * task
    start, end = kernel[at + START], kernel[NOW]
    return task, kernel[at + RELEASE], start, end, end - start - kernel[at + TIME], 0


@inlined
def next_lost(kernel: Ints) -> int:
    """Return the task of a lost alarm, of each one once and by task; NO_TASK if there is none."""
    for task in range((len(kernel) - HEAD) // STRIDE):
        at = HEAD + STRIDE * task
        if kernel[at + LOST]:
            kernel[at + LOST] -= 1
            return task
    return NO_TASK


@inlined
def set_duty(kernel: Ints, duty_x: int, duty_y: int) -> None:
    """Set the duty [%] now, at the end of a job; the same one again changes nothing."""
    if duty_x == kernel[DUTY_X] and duty_y == kernel[DUTY_Y]:
        return
    kernel[DUTY_X], kernel[DUTY_Y] = duty_x, duty_y
    kernel[DUTY_SET], kernel[DUTY_SENT] = kernel[NOW], NOT_YET


@inlined
def is_bus_busy(kernel: Ints, sonar_us: int) -> bool:
    """Return whether the sonar's bus is busy; otherwise it is from now on, for a reading."""
    if kernel[NOW] < kernel[BUS_FREE]:
        return True
    kernel[BUS_FREE] = kernel[NOW] + sonar_us
    return False


@inlined
def duty_effect(constants: KernelConstants, kernel: Ints) -> int:
    """Return when the newest duty takes effect, after all events of a tick.

    If the link has not taken it yet, it will with the next interrupt that sends.
    """
    if constants.has_link:
        if kernel[DUTY_SENT] >= 0:
            kernel[EFFECT] = kernel[DUTY_SENT] + constants.latency_us
            kernel[DUTY_SENT] = NOT_YET
        elif kernel[DUTY_SET] >= 0:
            first = max(kernel[NEXT_TICK], kernel[NOW])  # a blocked one comes late
            sends = first + (0 if kernel[LINK_SENDS] else TICK_US)
            kernel[EFFECT] = sends + constants.link_us + constants.latency_us
    elif kernel[DUTY_SET] >= 0:
        kernel[EFFECT], kernel[DUTY_SET] = kernel[DUTY_SET], NOT_YET
    return kernel[EFFECT]


def mean_duty_delay(constants: KernelConstants, job_us: float, sends: bool) -> float:
    """Return after what time [µs] a duty acts whose job is the first of its tick.

    The job takes `job_us`; `sends` is whether the link sends at the tick's first interrupt.
    """
    set_us = constants.interrupt_us + job_us
    if not constants.has_link:
        return set_us
    leaves_us = 2 * TICK_US if sends else TICK_US
    while leaves_us < set_us:
        leaves_us += 2 * TICK_US
    return leaves_us + constants.link_us + constants.latency_us


class Job(NamedTuple):
    """A job that has ended, or whose alarm was lost; times in µs.

    Attributes
    ----------
    release, start, end : int
        Those of a lost one are all the beginning of the tick in which its alarm was lost.
    preempted : int
        How long other tasks and interrupts had the processor between start and end.
    """

    task: str
    release: int
    start: int
    end: int
    preempted: int = 0
    is_lost: bool = False

    @classmethod
    def of(cls, tasks: Sequence[TaskTiming], numbers: JobNumbers) -> Job:
        """Return the job that numbers stand for."""
        task, release, start, end, preempted, is_lost = numbers
        return cls(tasks[task].name, release, start, end, preempted, bool(is_lost))


class OsekKernel:
    """A kernel with its tasks, whose first interrupt is at `start_us`.

    The offsets are ticks until the first alarm of each task; none stands for 0. Functions of the
    module change the `state`, see there.
    """

    def __init__(
        self,
        constants: KernelConstants,
        tasks: Iterable[TaskTiming],
        start_us: int = 0,
        *,
        sends: bool = True,
        offsets: Sequence[int] = (),
    ) -> None:
        self.constants = constants
        self.tasks = tuple(tasks)
        self.state = [0] * kernel_size(len(self.tasks))
        for number, task in enumerate(self.tasks):
            offset = offsets[number] if offsets else 0
            set_task(self.state, number, task.priority, task.period_ms, offset)
        start_kernel(self.state, start_us, sends)

    def next_event(self, until_us: int) -> int:
        """Let time pass; see :func:`next_event`."""
        return next_event(self.constants, self.state, until_us)

    def take_time(self, task: int, time_us: int) -> None:
        """Say how long the job takes that has just begun."""
        take_time(self.state, task, time_us)

    def has_begun(self, task: int) -> bool:
        """Return whether a job of a task has begun and not ended."""
        at = HEAD + STRIDE * task
        return self.state[at + ACTIVATED] > 0 and self.state[at + START] >= 0

    def ended(self, task: int) -> Job:
        """Return the job of a task that has just ended."""
        return Job.of(self.tasks, ended_job(self.state, task))

    def newly_lost(self, now_us: int) -> list[Job]:
        """Return the jobs whose alarms were lost since the last call, as of a time."""
        jobs = []
        while (task := next_lost(self.state)) >= 0:
            jobs.append(Job.of(self.tasks, (task, now_us, now_us, now_us, 0, 1)))
        return jobs

    def copy(self) -> OsekKernel:
        """Return a kernel in the same state, which goes on by itself."""
        twin = copy(self)
        twin.state = list(self.state)
        return twin
