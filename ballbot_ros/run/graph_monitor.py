"""Looks into a running graph now and then, without slowing it."""

from __future__ import annotations

import time
from collections.abc import Mapping
from itertools import islice

from rclpy.qos import QoSProfile, ReliabilityPolicy

from ballbot_ros.messages.conversions import time_ns
from ballbot_ros.messages.raw import decoder
from ballbot_ros.messages.topics import CLOCK, DIAGNOSTICS
from ballbot_ros.nodes.inbox import drain, hidden_node, raw_subscription
from ballbot_ros.nodes.processes import is_waiting, threads_by_process
from ballbot_ros.parameters import PLANT
from ballbot_ros.simulation.silence_timer import SilenceTimer, Threads

_REPORTS = 50
_decode = decoder(DIAGNOSTICS.type_name)

PLANT_SILENCE_S = 2.3
"""The plant reports at 1 Hz; if it has this much time of the machine and is silent, it hangs."""

PLANT_WAIT_S = 6.0
"""The same if it waits now and then: publishing takes 3 s if a reader of the plant's was killed
while it held the lock of its port. Fast DDS gives up only then."""

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
        self._heard_s = self._waited_s = now_s
        self._limit_s = PLANT_BUSY_S
        self._has_ended = False
        self._timer, self._busy_timer = SilenceTimer(), SilenceTimer()

    def hear(self, now_s: float, *, has_ended: bool = False) -> None:
        """Note a sign of life, and whether it tells of the end of the run."""
        self._heard_s = now_s
        self._has_ended = self._has_ended or has_ended
        self._limit_s = PLANT_BUSY_S if self._has_ended else PLANT_SILENCE_S

    def hangs(
        self, now_s: float, process: int, threads: Mapping[int, Threads], *, is_waiting: bool
    ) -> bool:
        """Tell whether the plant, which is this process, has been silent for too long."""
        if is_waiting:
            self._waited_s = now_s
        self._timer.update(self._heard_s, now_s, threads)
        self._busy_timer.update(max(self._heard_s, self._waited_s), now_s, threads)
        return self._busy_timer.silence_s(process) > self._limit_s or self._timer.silence_s(
            process
        ) > max(self._limit_s, PLANT_WAIT_S)


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
        self._clock = self._node.create_subscription(
            CLOCK.message_class, CLOCK.name, lambda message: None, newest
        )
        self._diagnostics = raw_subscription(self._node, DIAGNOSTICS, QoSProfile(depth=_REPORTS))
        self.now_ns = 0
        self._liveness = Liveness(time.monotonic())
        return self

    def __exit__(self, *error: object) -> None:
        self._node.destroy_node()

    def poll(self) -> None:
        """Take what has come since the last look."""
        for clock, _ in islice(drain(self._clock), 1):
            self.now_ns = time_ns(clock.clock)
            self._liveness.hear(time.monotonic())
        # No more than wait at once, and of what can't be the plant's only the bytes: anybody may
        # publish there, faster than it can be read.
        for data, _ in islice(drain(self._diagnostics), _REPORTS):
            if PLANT.encode() not in data:
                continue
            try:
                report = _decode(data)
            except ValueError:
                continue
            for status in report.status:
                keys = {value.key: value.value for value in status.values}
                if keys.get('role') == PLANT:
                    self._liveness.hear(time.monotonic(), has_ended='outcome' in keys)

    def plant_hangs(self, process: int) -> bool:
        """Tell whether the plant, which is this process, hangs."""
        return self._liveness.hangs(
            time.monotonic(),
            process,
            threads_by_process([process]),
            is_waiting=is_waiting(process),
        )
