"""The tasks of a controller on the brick: times, shares, responses, and what may come too late."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Callable, Iterator
from dataclasses import replace
from time import process_time_ns
from typing import Any, NamedTuple

from ballbot_ros.controllers.codegen.implementation import implementation_for
from ballbot_ros.controllers.controller import IDLE
from ballbot_ros.controllers.document.axis import task_timings
from ballbot_ros.controllers.document.program import longest_times
from ballbot_ros.controllers.loading import LoadedController
from ballbot_ros.engine.closed_loop import ClosedLoop
from ballbot_ros.parameters import CONTROLLER, ControllerParameters, ParameterError, ParameterSet
from ballbot_ros.robot.brick import job_times, response_times
from ballbot_ros.robot.brick.kernel import TICK_US

SHORTEST_MS, LONGEST_MS = 20_000, 300_000
"""Limits of a simulation, which has a hyperperiod; that of the document's tasks is 500."""

MEASURED_TICKS = 3000


class BrickTask(NamedTuple):
    """A task on the brick, all of whose jobs take their longest path; its responses.

    The share of the processor is without the interrupts of the bus, which lengthen the time.
    """

    name: str
    priority: int
    period_ms: int
    time_us: int
    share: float
    worst_us: int | None
    is_exact: bool
    simulated_us: int | None
    lost: int


def schedule_of(
    settings: ControllerParameters, loaded: LoadedController | None
) -> tuple[list[BrickTask], int]:
    """Return the tasks for parameters with `kernel`, and how long they have been simulated [ms].

    The class is None for the document's program. It raises ParameterError if a task takes no time.
    """
    times, constants = job_times.job_times(settings), job_times.kernel_constants(settings)
    timings = loaded.tasks if loaded else task_timings(settings.ts2_period, settings.ts3_period)
    own_times = {each.name: times.own for each in timings}
    longest = own_times if loaded else longest_times(times)
    tasks = [
        response_times.TaskTime(each, job_times.whole_time(times, longest[each.name], 1.0))
        for each in timings
        if each.name != IDLE
    ]
    for timing, time_us in tasks:
        if not time_us:
            name = f'{CONTROLLER}.tick_time' if loaded else f'{CONTROLLER}: time of {timing.name}'
            raise ParameterError(f'{name}: 0 µs; responses are known only of tasks that take time')
    until_ms = math.lcm(*(each.period_ms or 1 for each in timings))
    until_ms = min(max(until_ms, SHORTEST_MS), LONGEST_MS)
    simulated = response_times.simulated_responses(constants, tasks, TICK_US * until_ms)
    worst = response_times.worst_responses(constants, tasks)
    free = job_times.free_clock(settings) / settings.processor_clock / TICK_US
    return [
        BrickTask(*timing, us, free * us / (timing.period_ms or until_ms), *limit, *found)
        for (timing, us), limit, found in zip(tasks, worst, simulated, strict=True)
    ], until_ms


def warnings_of(settings: ControllerParameters, tasks: list[BrickTask]) -> Iterator[str]:
    """Yield what may come too late: a job after the next alarm of its task, a duty for the link."""
    periodic = [task for task in tasks if task.period_ms]
    for task in periodic:
        if task.worst_us is None or task.worst_us > TICK_US * task.period_ms:
            after = f'{task.worst_us} µs' if task.worst_us else 'any time'
            yield (
                f'{task.name} may end {after} after its alarm, beyond its {task.period_ms} ms: '
                'alarms are then lost'
            )
    sender = min(periodic, key=lambda task: (task.period_ms, -task.priority))
    # Late interrupts change the phase.
    is_drawn = settings.link_phase < 0 or (settings.kernel_defect and not sender.is_exact)
    for phase in (0, 1) if is_drawn else (settings.link_phase,):
        slack_ms = 2 - phase  # task_ts1 begins at even milliseconds
        late_us = (sender.worst_us or 0) - TICK_US * slack_ms
        if late_us > 0:
            yield (
                f'{sender.name} may set its duty {sender.worst_us} µs after its alarm; with '
                f'link_phase {phase}, the link takes duties {slack_ms} ms after the alarm, so this '
                f'one leaves {2 * math.ceil(late_us / (2 * TICK_US))} ms late'
            )


def measured_time(parameters: ParameterSet, loaded: LoadedController) -> float:
    """Return the processor time of jobs on this machine while the robot balances [µs].

    It is the 99 % quantile of the slowest task, so the first jobs do not count.
    """
    took: dict[str, list[int]] = defaultdict(list)

    def timed(method: Callable[[Any, Any], Any]) -> Callable[[Any, Any], Any]:
        def run(controller: Any, readings: Any) -> Any:
            begun_ns = process_time_ns()
            answer = method(controller, readings)
            took[method.__name__].append(process_time_ns() - begun_ns)
            return answer

        return run

    names = [each.name for each in loaded.tasks if each.name != IDLE]
    methods = {name: timed(getattr(loaded.cls, name)) for name in names}
    measured = replace(loaded, cls=type(loaded.cls.__name__, (loaded.cls,), methods))
    program = implementation_for(parameters.of(ControllerParameters), measured).make()
    loop = ClosedLoop(parameters, program=program)
    for _ in range(MEASURED_TICKS):
        loop.tick()
    return max(sorted(each)[99 * len(each) // 100] for each in took.values()) / 1e3
