"""Ends a tick that does not return, in the process that would hang with it.

In separate processes the plant notices a controller that does not return. With all nodes in one
process, or without nodes, the plant hangs, too, and only a signal interrupts it.
"""

from __future__ import annotations

import math
import signal
import sys
import threading
import time
from contextlib import suppress
from pathlib import Path
from types import FrameType

from ballbot_ros.controllers.controller_program import ControllerProgram, running_tick
from ballbot_ros.controllers.loading import LoadedController
from ballbot_ros.errors import TickTimeoutError
from ballbot_ros.lockstep.liveness import MAX_POLL_GAP_S, ThreadTime, available_s
from ballbot_ros.parameters import PlantParameters
from ballbot_ros.process import StopRequest

_NOW_S = 1e-6
_SCHEDSTAT = Path('/proc/thread-self/schedstat')


class TickTimer:
    """Context in which each tick of a controller that is not part of this package has to return.

    A repeating timer interrupts the main thread. If it finds the thread twice in the same tick, the
    time between counts, without waits for a processor. Beyond the plant's timeout, or as soon as a
    stop is requested, it raises TickTimeoutError at the line that is being executed. In other
    threads, which signals do not interrupt, the context does nothing.
    """

    def __init__(
        self,
        loaded: LoadedController | None,
        plant: PlantParameters,
        stop: StopRequest | None = None,
    ) -> None:
        is_main = threading.current_thread() is threading.main_thread()
        self._is_needed = is_main and loaded is not None and not loaded.code.is_ours
        self._plant, self._stop = plant, stop
        self._tick: FrameType | None = None
        self._seen_s, self._thread = 0.0, ThreadTime(0.0, 0.0, False)
        self._spent_s, self._has_raised = 0.0, False

    def __enter__(self) -> None:
        if self._is_needed:
            self._begun_s = time.monotonic()
            self._handler = signal.signal(signal.SIGALRM, self._check)
            self._timer = signal.setitimer(signal.ITIMER_REAL, MAX_POLL_GAP_S, MAX_POLL_GAP_S)

    def __exit__(self, *error: object) -> None:
        if self._is_needed:
            signal.setitimer(signal.ITIMER_REAL, 0)
            signal.signal(signal.SIGALRM, self._handler or signal.SIG_DFL)
            delay_s, interval_s = self._timer
            if delay_s:
                delay_s = max(delay_s - (time.monotonic() - self._begun_s), _NOW_S)
                signal.setitimer(signal.ITIMER_REAL, delay_s, interval_s)
            self._tick = None

    def _check(self, number: int, frame: FrameType | None) -> None:
        tick = running_tick(frame)
        seen_s, thread = self._seen_s, self._thread
        self._seen_s, self._thread = time.monotonic(), _thread_time()
        if tick is None or tick is not self._tick:
            self._tick, self._spent_s, self._has_raised = tick, 0.0, False
            return
        self._spent_s += available_s({0: self._thread}, {0: thread}, self._seen_s - seen_s)
        limit_s = self._limit_s(tick.f_locals['self'])
        if self._spent_s <= limit_s and not (self._stop and self._stop.signal):
            return
        why = f'within {limit_s:g} s' if self._spent_s > limit_s else 'after a request to stop'
        error = TickTimeoutError(f'does not return {why}')
        if self._has_raised:
            _raise_in_next_line(frame, tick, error)
        self._has_raised = True
        raise error

    def _limit_s(self, program: ControllerProgram) -> float:
        if self._plant.on_timeout != 'end':
            return math.inf
        return self._plant.timeout if program.times.ticks else self._plant.startup_timeout


def _raise_in_next_line(frame: FrameType | None, tick: FrameType, error: BaseException) -> None:
    """Let the line that runs next raise an error, too: that of an ``except`` that catches it."""

    def trace(frame: FrameType, event: str, argument: object) -> object:
        if event == 'line':
            raise error  # which also ends the tracing
        return trace

    sys.settrace(lambda frame, event, argument: None)
    while frame and frame is not tick:
        frame.f_trace, frame = trace, frame.f_back


def _thread_time() -> ThreadTime:
    """Return the times of this thread; a system without schedstat does not tell its waits."""
    queued_ns = 0
    with suppress(OSError, ValueError, IndexError):
        queued_ns = int(_SCHEDSTAT.read_text().split()[1])
    return ThreadTime(time.thread_time(), queued_ns * 1e-9, is_runnable=False)
