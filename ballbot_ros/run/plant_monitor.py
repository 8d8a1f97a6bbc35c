"""Watches the plant of a running graph."""

from __future__ import annotations

import time
from collections.abc import Mapping

from ballbot_ros.nodes.heartbeat import HeartbeatPipe
from ballbot_ros.nodes.processes import threads_by_process
from ballbot_ros.simulation.silence_timer import SilenceTimer, Threads

PLANT_SILENCE_S = 2.3
"""Silence after which the plant counts as hung [s]. Time in which the machine is too busy to run it
does not count."""

PLANT_BUSY_S = 30.0
"""The same before the plant's first heartbeat, while its process starts, and after the end of its
run, while it saves the result."""


class PlantWatchdog:
    """Distinguishes a plant that hangs from one that is starved; heard of at `heard_s` [s]."""

    def __init__(self, now_s: float) -> None:
        self.heard_s = now_s
        self._limit_s = PLANT_BUSY_S
        self._has_ended = False
        self._timer = SilenceTimer()

    def feed(self, now_s: float, *, has_ended: bool = False) -> None:
        """Note a sign of life of the plant, and whether it reports the end of the run."""
        self.heard_s = now_s
        self._has_ended = self._has_ended or has_ended
        self._limit_s = PLANT_BUSY_S if self._has_ended else PLANT_SILENCE_S

    def is_hung(self, now_s: float, process: int, threads: Mapping[int, Threads]) -> bool:
        """Return whether the plant, which runs as `process`, has been silent for too long."""
        self._timer.update(self.heard_s, now_s, threads)
        return self._timer.silence_s(process) > self._limit_s


class PlantMonitor:
    """Sim time and the plant's signs of life; before the first tick, `now_ns` is 0.

    Attributes
    ----------
    pipe : HeartbeatPipe
    now_ns : int
    """

    def __init__(self) -> None:
        self.pipe = HeartbeatPipe()
        self.now_ns = 0
        self._watchdog = PlantWatchdog(time.monotonic())

    def __enter__(self) -> PlantMonitor:
        return self

    def __exit__(self, *error: object) -> None:
        self.pipe.close()

    def poll(self) -> None:
        """Process what has arrived since the last poll."""
        if beat := self.pipe.newest():
            self.now_ns = beat.now_ns
            self._watchdog.feed(time.monotonic(), has_ended=beat.has_ended)

    def plant_hangs(self, process: int) -> bool:
        """Return whether the plant, which runs as `process`, hangs."""
        threads = threads_by_process([process])
        return self._watchdog.is_hung(time.monotonic(), process, threads)
