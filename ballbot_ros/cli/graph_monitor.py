"""Looks into a running graph now and then, without slowing it."""

from __future__ import annotations

import time
from typing import Any

from rclpy.qos import QoSProfile, ReliabilityPolicy

from ballbot_ros.messages.conversions import time_ns
from ballbot_ros.messages.topics import CLOCK, DIAGNOSTICS
from ballbot_ros.nodes.inbox import hidden_node, taken
from ballbot_ros.parameters import PLANT

PLANT_SILENCE_S = 2.3
"""The plant reports at 1 Hz; after this it hangs."""

PLANT_STARTUP_S = 30.0
"""The same until it is heard for the first time: its process has to start."""


class GraphMonitor:
    """Sim time and the plant's sign of life.

    Its node is spun by no executor: a look costs what it costs when it is taken, not at every
    tick.

    Attributes
    ----------
    now_ns : int
        The newest sim time [ns]; 0 before the first tick.
    """

    def __enter__(self) -> GraphMonitor:
        self._node = hidden_node('ballbot_monitor')
        newest = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
        self._clock = self._subscribe(CLOCK, newest)
        self._diagnostics = self._subscribe(DIAGNOSTICS, QoSProfile(depth=50))
        self.now_ns = 0
        self._heard_at = time.monotonic()
        self._limit_s = PLANT_STARTUP_S
        return self

    def __exit__(self, *error: object) -> None:
        self._node.destroy_node()

    def _subscribe(self, topic: Any, qos: QoSProfile) -> Any:
        return self._node.create_subscription(
            topic.message_class, topic.name, lambda message: None, qos
        )

    def poll(self) -> None:
        """Take what has come since the last look."""
        for clock, _ in taken(self._clock):
            self.now_ns = time_ns(clock.clock)
            self._hear()
        for report, _ in taken(self._diagnostics):
            if any(status.name.startswith(f'{PLANT}:') for status in report.status):
                self._hear()

    def _hear(self) -> None:
        self._heard_at = time.monotonic()
        self._limit_s = PLANT_SILENCE_S

    @property
    def plant_hangs(self) -> bool:
        """Whether the plant has been silent for too long."""
        return time.monotonic() - self._heard_at > self._limit_s
