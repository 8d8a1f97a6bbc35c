"""Watches the plant of a running graph."""

from __future__ import annotations

import time
from collections.abc import Iterable, Mapping

from ballbot_ros.nodes.heartbeat import HeartbeatPipe
from ballbot_ros.nodes.processes import is_waiting, threads_by_process
from ballbot_ros.simulation.silence_timer import SilenceTimer, Threads

PLANT_SILENCE_S = 2.3
"""Silence after which the plant counts as hung [s]. Time in which the
machine is too busy to run it does not count."""

PLANT_WAIT_S = 6.0
"""The same for a plant whose main thread waits from time to time: if a reader was killed while it
held the lock of its port, publishing blocks for 3 s, until Fast DDS gives up. Time in which the
machine is too busy to run another process of the run, for which it may wait, does not count."""

QUIET_S = 0.3
"""Silence after which the other processes are observed, too [s]."""

PLANT_BUSY_S = 30.0
"""The same before the plant's first heartbeat, while its process starts, and after the end of its
run, while it saves the result."""


class PlantWatchdog:
    """Distinguishes a plant that hangs from one that is starved; heard of at `heard_s` [s]."""

    def __init__(self, now_s: float) -> None:
        self.heard_s = self._waited_s = now_s
        self._limit_s = PLANT_BUSY_S
        self._has_ended = False
        self._timer, self._busy_timer = SilenceTimer(), SilenceTimer()

    def feed(self, now_s: float, *, has_ended: bool = False) -> None:
        """Note a sign of life of the plant, and whether it reports the end of the run."""
        self.heard_s = now_s
        self._has_ended = self._has_ended or has_ended
        self._limit_s = PLANT_BUSY_S if self._has_ended else PLANT_SILENCE_S

    def is_hung(
        self, now_s: float, process: int, threads: Mapping[int, Threads], *, is_waiting: bool
    ) -> bool:
        """Return whether the plant, which runs as `process`, has been silent for too long.

        `threads` are those of all observed processes of the run.
        """
        if is_waiting:
            self._waited_s = now_s
        self._timer.update(self.heard_s, now_s, threads)
        self._busy_timer.update(max(self.heard_s, self._waited_s), now_s, threads)
        waited_s = min(self._timer.silence_s(each) for each in (process, *threads))
        is_busy = self._busy_timer.silence_s(process) > self._limit_s
        return is_busy or waited_s > max(self._limit_s, PLANT_WAIT_S)


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

    def plant_hangs(self, process: int, others: Iterable[int] = ()) -> bool:
        """Return whether the plant, which runs as `process`, hangs next to other processes."""
        now_s = time.monotonic()
        is_quiet = now_s - self._watchdog.heard_s > QUIET_S
        observed = [process, *(others if is_quiet else ())]
        return self._watchdog.is_hung(
            now_s, process, threads_by_process(observed), is_waiting=is_waiting(process)
        )
