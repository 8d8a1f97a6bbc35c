"""A timer that fires once, so that no callback has to sleep."""

from __future__ import annotations

from collections.abc import Callable

from rclpy.clock import Clock, ClockType
from rclpy.node import Node


class OneShotTimer:
    """Calls back once after each :meth:`start`, on the wall clock."""

    def __init__(self, node: Node, callback: Callable[[], None]) -> None:
        self._callback = callback
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._timer = node.create_timer(1.0, self._fire, clock=steady, autostart=False)

    def start(self, delay_s: float) -> None:
        """Call back in `delay_s` [s]; this replaces a pending call."""
        self._timer.timer_period_ns = max(1, round(delay_s * 1e9))
        self._timer.reset()

    def cancel(self) -> None:
        """Cancel the pending call."""
        self._timer.cancel()

    def _fire(self) -> None:
        self._timer.cancel()
        self._callback()
