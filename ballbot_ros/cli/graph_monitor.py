"""Looks into a running graph now and then, without slowing it."""

from __future__ import annotations

import time
from collections.abc import Mapping
from typing import Any

from diagnostic_msgs.msg import KeyValue
from rclpy.qos import QoSProfile, ReliabilityPolicy

from ballbot_ros.messages.conversions import time_ns
from ballbot_ros.messages.topics import CLOCK, DIAGNOSTICS
from ballbot_ros.nodes.inbox import hidden_node, taken
from ballbot_ros.parameters import PLANT
from ballbot_ros.processes import threads_by_process
from ballbot_ros.simulation.silence_timer import SilenceTimer, Threads

_ROLE_OF_PLANT = KeyValue(key='role', value=PLANT)

PLANT_SILENCE_S = 2.3
"""The plant reports at 1 Hz; if it has this much time of the machine and is silent, it hangs."""

PLANT_BUSY_S = 30.0
"""The same until it is heard for the first time, as its process has to start, and once its run has
ended, as it saves what the run has given."""


class Liveness:
    """Tells a plant that hangs from one that the machine keeps waiting.

    Parameters
    ----------
    now_s : float
        The time, here and below on a clock that only goes forward [s].
    """

    def __init__(self, now_s: float) -> None:
        self._heard_s = now_s
        self._limit_s = PLANT_BUSY_S
        self._has_ended = False
        self._timer = SilenceTimer()

    def hear(self, now_s: float, *, has_ended: bool = False) -> None:
        """Note a sign of life, and whether it tells of the end of the run."""
        self._heard_s = now_s
        self._has_ended = self._has_ended or has_ended
        self._limit_s = PLANT_BUSY_S if self._has_ended else PLANT_SILENCE_S

    def hangs(self, now_s: float, process: int, threads: Mapping[int, Threads]) -> bool:
        """Tell whether the plant, which is this process, has been silent for too long."""
        self._timer.update(self._heard_s, now_s, threads)
        return self._timer.silence_s(process) > self._limit_s


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
            for status in report.status:
                if _ROLE_OF_PLANT in status.values:
                    has_ended = any(value.key == 'outcome' for value in status.values)
                    self._liveness.hear(time.monotonic(), has_ended=has_ended)

    def plant_hangs(self, process: int) -> bool:
        """Tell whether the plant, which is this process, hangs."""
        return self._liveness.hangs(time.monotonic(), process, threads_by_process([process]))
