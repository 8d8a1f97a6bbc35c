"""The OSEK schedule: periodic tasks, their phases and priorities."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import NamedTuple


class TaskTiming(NamedTuple):
    """Priority and period of a task, whose name is also that of the function.

    Higher priorities run first. The period is that of its alarm [ms]; 0 for a task that runs once
    at the start.
    """

    name: str
    priority: int
    period_ms: int


class Schedule:
    """Determines the tasks due at a time, highest priority first; all alarms start in phase.

    A tick is much longer than its tasks, so each runs to its end before the next.
    """

    def __init__(self, tasks: Iterable[TaskTiming]) -> None:
        self.tasks = sorted(tasks, key=lambda task: -task.priority)
        self._cycle_ms = math.lcm(*(task.period_ms or 1 for task in self.tasks))
        self._due: dict[int, list[str]] = {}

    def due(self, elapsed_ms: int) -> list[str]:
        """Return the names of the tasks due `elapsed_ms` after the start, by priority."""
        at = elapsed_ms % self._cycle_ms if elapsed_ms else -1
        if at not in self._due:
            self._due[at] = [
                name
                for name, _, period_ms in self.tasks
                if (elapsed_ms % period_ms == 0 if period_ms else elapsed_ms == 0)
            ]
        return self._due[at]
