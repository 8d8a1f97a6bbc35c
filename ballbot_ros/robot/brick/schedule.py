"""The OSEK schedule: periodic tasks, their phases and priorities."""

from __future__ import annotations

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

    def due(self, elapsed_ms: int) -> list[str]:
        """Return the names of the tasks due `elapsed_ms` after the start, by priority."""
        return [
            name
            for name, _, period_ms in self.tasks
            if (elapsed_ms % period_ms == 0 if period_ms else elapsed_ms == 0)
        ]
