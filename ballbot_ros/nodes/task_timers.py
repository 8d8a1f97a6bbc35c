"""The timers of the control program's tasks."""

from __future__ import annotations

from collections.abc import Callable, Iterable

from rclpy.clock import Clock
from rclpy.node import Node
from rclpy.timer import Timer

from ballbot_ros.brick.schedule import TaskTiming
from ballbot_ros.timing import MILLISECOND_NS


class TaskTimers:
    """A timer for each periodic task.

    Parameters
    ----------
    on_timer : callable
        Called with the name of a task when its timer fires.
    ticking : str
        The task whose timer makes the ticks, and so runs before the first one; '' in lockstep,
        where all timers start with the first tick, and :meth:`poll` calls the callbacks instead of
        the node's executor.
    """

    def __init__(
        self, node: Node, clock: Clock, on_timer: Callable[[str], None], ticking: str
    ) -> None:
        self._node, self._clock, self._on_timer, self._ticking = node, clock, on_timer, ticking
        self._is_polled = not ticking
        self._timers: dict[str, Timer] = {}

    def set(self, tasks: Iterable[TaskTiming]) -> None:
        """Replace the timers by those of other tasks."""
        for timer in self._timers.values():
            timer.destroy() if self._is_polled else self._node.destroy_timer(timer)
        self._timers = {
            name: self._create(name, period_ms) for name, _, period_ms in tasks if period_ms
        }

    def _create(self, task: str, period_ms: int) -> Timer:
        if self._is_polled:
            group = self._node.default_callback_group
            return Timer(
                self._callback(task), group, period_ms * MILLISECOND_NS, self._clock,
                context=self._node.context, autostart=False,
            )  # fmt: skip
        return self._node.create_timer(
            period_ms * 1e-3,
            self._callback(task),
            clock=self._clock,
            autostart=task == self._ticking,
        )

    def _callback(self, task: str) -> Callable[[], None]:
        return lambda: self._on_timer(task)

    def poll(self) -> None:
        """Call the callbacks of the timers that are due."""
        for timer in list(self._timers.values()):
            if timer.is_ready():
                timer.handle.call_timer()
                timer.callback()

    def stop(self) -> None:
        """Stop the timers, which are not in phase with a new run; its ticks restart them."""
        for name, timer in self._timers.items():
            if name != self._ticking:
                timer.cancel()

    def restart(self, tasks: Iterable[str]) -> None:
        """Restart the timers of some tasks, which then fire one period from now."""
        for task in tasks:
            self._timers[task].reset()
