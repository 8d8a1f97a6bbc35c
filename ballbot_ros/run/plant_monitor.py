"""Watches the plant of a running graph without slowing it down."""

from __future__ import annotations

import time
from collections.abc import Mapping
from itertools import islice

from rclpy.qos import QoSProfile, ReliabilityPolicy

from ballbot_ros.messages.conversions import time_ns
from ballbot_ros.messages.topics import CLOCK
from ballbot_ros.nodes.inbox import drain, hidden_node
from ballbot_ros.nodes.plant_reports import PlantReports
from ballbot_ros.nodes.processes import is_waiting, threads_by_process
from ballbot_ros.simulation.silence_timer import SilenceTimer, Threads

PLANT_SILENCE_S = 2.3
"""Silence after which the plant, which reports at 1 Hz, counts as hung [s]. Time in which the
machine is too busy to run it does not count."""

PLANT_WAIT_S = 6.0
"""The same for a plant whose main thread waits from time to time: if a reader was killed while it
held the lock of its port, publishing blocks for 3 s, until Fast DDS gives up."""

PLANT_BUSY_S = 30.0
"""The same before the plant's first report, while its process starts, and after the end of its run,
while it saves the result."""


class PlantWatchdog:
    """Distinguishes a plant that hangs from one that is starved of processor time."""

    def __init__(self, now_s: float) -> None:
        self._heard_s = self._waited_s = now_s
        self._limit_s = PLANT_BUSY_S
        self._has_ended = False
        self._timer, self._busy_timer = SilenceTimer(), SilenceTimer()

    def feed(self, now_s: float, *, has_ended: bool = False) -> None:
        """Note a sign of life of the plant, and whether it reports the end of the run."""
        self._heard_s = now_s
        self._has_ended = self._has_ended or has_ended
        self._limit_s = PLANT_BUSY_S if self._has_ended else PLANT_SILENCE_S

    def is_hung(
        self, now_s: float, process: int, threads: Mapping[int, Threads], *, is_waiting: bool
    ) -> bool:
        """Return whether the plant, which runs as `process`, has been silent for too long."""
        if is_waiting:
            self._waited_s = now_s
        self._timer.update(self._heard_s, now_s, threads)
        self._busy_timer.update(max(self._heard_s, self._waited_s), now_s, threads)
        return self._busy_timer.silence_s(process) > self._limit_s or self._timer.silence_s(
            process
        ) > max(self._limit_s, PLANT_WAIT_S)


class PlantMonitor:
    """Sim time and the plant's signs of life; before the first tick, `now_ns` is 0.

    No executor spins its node: the cost is per poll, not per tick.
    """

    def __enter__(self) -> PlantMonitor:
        self._node = hidden_node('ballbot_monitor')
        newest = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
        self._clock = self._node.create_subscription(
            CLOCK.message_class, CLOCK.name, lambda message: None, newest
        )
        self._reports = PlantReports(self._node)
        self.now_ns = 0
        self._watchdog = PlantWatchdog(time.monotonic())
        return self

    def __exit__(self, *error: object) -> None:
        self._node.destroy_node()

    def poll(self) -> None:
        """Process the messages that have arrived since the last poll."""
        for clock, _ in islice(drain(self._clock), 1):
            self.now_ns = time_ns(clock.clock)
            self._watchdog.feed(time.monotonic())
        for report in self._reports.take():
            self._watchdog.feed(time.monotonic(), has_ended=bool(report.outcome))

    def plant_hangs(self, process: int) -> bool:
        """Return whether the plant, which runs as `process`, hangs."""
        return self._watchdog.is_hung(
            time.monotonic(), process, threads_by_process([process]), is_waiting=is_waiting(process)
        )
