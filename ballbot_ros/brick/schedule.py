"""The OSEK schedule: periodic tasks, their phases and priorities."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass


@dataclass(frozen=True)
class Task:
    """A task and the alarm that activates it.

    Attributes
    ----------
    name : str
        Name in the OIL file.
    priority : int
        Larger runs first.
    period_ms : int
        Cycle of the alarm; 0 for a task that runs once at the start.
    body : callable
        What it does.
    """

    name: str
    priority: int
    period_ms: int
    body: Callable[[], None]


class Schedule:
    """What is due when, most urgent first; all alarms start in phase.

    A tick is far longer than the tasks take, so each runs to its end before the next one.

    Parameters
    ----------
    tasks : iterable of Task
    """

    def __init__(self, tasks: Iterable[Task]) -> None:
        self.tasks = sorted(tasks, key=lambda task: -task.priority)

    def due(self, elapsed_ms: int) -> list[Task]:
        """Return the tasks due `elapsed_ms` after the start, most urgent first."""
        return [
            task
            for task in self.tasks
            if (elapsed_ms % task.period_ms == 0 if task.period_ms else elapsed_ms == 0)
        ]

    def run(self, elapsed_ms: int) -> None:
        """Run what is due."""
        for task in self.due(elapsed_ms):
            task.body()
