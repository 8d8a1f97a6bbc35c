"""The releases of the control program's tasks, each for one tick."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from typing import NamedTuple

from ballbot_ros.brick.schedule import Schedule, TaskTiming
from ballbot_ros.timing import MILLISECOND_NS


class DueTick(NamedTuple):
    """A tick that is due.

    Attributes
    ----------
    tasks : tuple of str
        The tasks to run, highest priority first.
    untimed : tuple of str
        Those of `tasks` that their timers have not released; these timers must be restarted.
    """

    time_ns: int
    tasks: tuple[str, ...]
    untimed: tuple[str, ...]


class TaskReleases:
    """The releases of the tasks by their timers and by the start of a run.

    A timer releases its task for the time at which it fires. The start of a run releases all tasks
    due at the first tick, because no timer fires there after a jump of the clock. A release off the
    schedule, or a second one for the same time, changes nothing.

    Attributes
    ----------
    forced : int
        Number of releases made without a timer.
    """

    def __init__(self) -> None:
        self.fired: Counter[str] = Counter()
        self.forced = 0
        self._schedule = Schedule(())
        self._periods_ns: dict[str, int] = {}
        self._released_ns: dict[str, int] = {}
        self._start_ns = 0
        self._forced_ns: int | None = None

    def begin(self, start_ns: int, tasks: Iterable[TaskTiming]) -> None:
        """Begin a run of `tasks` whose first tick is at `start_ns` [ns]."""
        self._schedule = Schedule(tasks)
        self._periods_ns = {
            task.name: task.period_ms * MILLISECOND_NS
            for task in self._schedule.tasks
            if task.period_ms
        }
        self._released_ns.clear()
        self._start_ns, self._forced_ns = start_ns, None

    def release(self, task: str, now_ns: int) -> None:
        """Release a task whose timer fired at sim time `now_ns` [ns]."""
        self.fired[task] += 1
        period_ns = self._periods_ns.get(task)
        if period_ns is None or now_ns < self._released_ns.get(task, self._start_ns):
            return
        if (now_ns - self._start_ns) % period_ns == 0:
            self._released_ns[task] = now_ns

    def missing(self, tick_ns: int) -> tuple[str, ...]:
        """Return the tasks due at `tick_ns` [ns] that have not been released for it."""
        if tick_ns in (self._start_ns, self._forced_ns):
            return ()
        return self._untimed(self._due(tick_ns), tick_ns)

    def force(self, tick_ns: int) -> None:
        """Release, and count, the tasks missing at `tick_ns` [ns]."""
        self.forced += len(self.missing(tick_ns))
        self._forced_ns = tick_ns

    def take(self, tick_ns: int) -> DueTick:
        """Return the tick at `tick_ns` [ns], for which no release may be missing."""
        due = self._due(tick_ns)
        return DueTick(tick_ns, due, self._untimed(due, tick_ns))

    def _due(self, tick_ns: int) -> tuple[str, ...]:
        return tuple(self._schedule.due((tick_ns - self._start_ns) // MILLISECOND_NS))

    def _untimed(self, due: Iterable[str], tick_ns: int) -> tuple[str, ...]:
        return tuple(
            name
            for name in due
            if name in self._periods_ns and self._released_ns.get(name) != tick_ns
        )
