"""Looks into a running graph now and then, without slowing it."""

from __future__ import annotations

import time
from typing import Any

from diagnostic_msgs.msg import KeyValue
from rclpy.qos import QoSProfile, ReliabilityPolicy

from ballbot_ros.messages.conversions import time_ns
from ballbot_ros.messages.topics import CLOCK, DIAGNOSTICS
from ballbot_ros.nodes.inbox import hidden_node, taken
from ballbot_ros.parameters import PLANT

_ROLE_OF_PLANT = KeyValue(key='role', value=PLANT)

PLANT_SILENCE_S = 2.3
"""The plant reports at 1 Hz; if it is silent for so long and does nothing, it hangs."""

PLANT_STARTUP_S = 30.0
"""The same until it is heard for the first time, as its process has to start; and while it works,
as one that gets little of a busy machine does, or that saves what the run has given."""


class Liveness:
    """Tells a plant that hangs from one that is slow.

    Parameters
    ----------
    now_s : float
        The time, here and below on a clock that only goes forward [s].
    """

    def __init__(self, now_s: float) -> None:
        self._heard_s = self._worked_s = now_s
        self._cpu_s = 0.0
        self._limit_s = PLANT_STARTUP_S

    def hear(self, now_s: float) -> None:
        """Note a sign of life."""
        self._heard_s = now_s
        self._limit_s = PLANT_SILENCE_S

    def see(self, cpu_s: float, now_s: float) -> None:
        """Note how much processor time the plant has used."""
        if cpu_s > self._cpu_s:
            self._cpu_s, self._worked_s = cpu_s, now_s

    def hangs(self, now_s: float) -> bool:
        """Tell whether the plant has been silent for too long."""
        silence_s = now_s - self._heard_s
        is_idle = now_s - self._worked_s > self._limit_s
        return silence_s > (self._limit_s if is_idle else PLANT_STARTUP_S)


class GraphMonitor:
    """Sim time and the plant's signs of life.

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
        self._liveness = Liveness(time.monotonic())
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
            self._liveness.hear(time.monotonic())
        for report, _ in taken(self._diagnostics):
            if any(_ROLE_OF_PLANT in status.values for status in report.status):
                self._liveness.hear(time.monotonic())

    def plant_hangs(self, cpu_s: float) -> bool:
        """Tell whether the plant, which has used `cpu_s` of processor time [s], hangs."""
        now = time.monotonic()
        self._liveness.see(cpu_s, now)
        return self._liveness.hangs(now)
