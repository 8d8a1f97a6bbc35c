"""Signals as requests to stop instead of interruptions."""

from __future__ import annotations

import signal
import threading
from types import FrameType
from typing import Any

STOP_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


class StopRequest:
    """Context in which signals do not interrupt: they are noted in `signal`, for a loop to check.

    The handler does nothing else: it may interrupt any code, including code that holds a lock that
    the handler would need. A signal noted by an enclosing block counts here, too. An ignored
    hangup, as with ``nohup``, stays ignored. Outside the main thread, a block notes nothing.

    Attributes
    ----------
    signal : int
        The first signal that arrived, or 0.
    """

    def __init__(self) -> None:
        self.signal = 0
        self._before: dict[int, Any] = {}

    def __enter__(self) -> StopRequest:
        is_main = threading.current_thread() is threading.main_thread()
        for number in STOP_SIGNALS if is_main else ():
            if number == signal.SIGHUP and signal.getsignal(number) is signal.SIG_IGN:
                continue
            self._before[number] = before = signal.signal(number, self._on_signal)
            outer = getattr(before, '__self__', None)
            if isinstance(outer, StopRequest):
                self.signal = self.signal or outer.signal
        return self

    def __exit__(self, *error: object) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)

    def _on_signal(self, number: int, frame: FrameType | None) -> None:
        self.signal = self.signal or number


class DeferredSignals(StopRequest):
    """Context in which signals have no effect until it ends.

    Use it around imports, where a program may continue after an interruption: Python prints and
    ignores one in the import system's callbacks, and some packages, such as trimesh, mistake it for
    a missing dependency.
    """

    def __exit__(self, *error: object) -> None:
        super().__exit__()
        if self.signal:
            signal.raise_signal(self.signal)


class ProgramEnd(StopRequest):
    """Context of a whole program, which the first signal leaves with an exception.

    It is KeyboardInterrupt for SIGINT, otherwise SystemExit with 128 plus the number. Afterwards,
    and while the interpreter ends, signals have no effect: the program is already ending.
    """

    def __exit__(self, *error: object) -> None:
        for number in self._before:
            signal.signal(number, signal.SIG_IGN)

    def _on_signal(self, number: int, frame: FrameType | None) -> None:
        if not self.signal:
            self.signal = number
            raise KeyboardInterrupt if number == signal.SIGINT else SystemExit(128 + number)
