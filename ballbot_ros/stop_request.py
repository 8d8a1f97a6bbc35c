"""Signals as requests to stop instead of interruptions."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from types import FrameType
from typing import Any

STOP_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


class StopRequest:
    """Context in which signals do not interrupt: they are noted in `signal`, for a loop to check.

    The handler does nothing else: it may interrupt any code, including code that holds a lock that
    the handler would need. A signal noted by an enclosing block counts here, too. An ignored
    hangup, as with ``nohup``, stays ignored. Outside the main thread, a block notes nothing.

    Parameters
    ----------
    numbers : sequence of int
        The signals to note.

    Attributes
    ----------
    signal : int
        The first signal that arrived, or 0.
    """

    def __init__(
        self,
        numbers: Sequence[int] = STOP_SIGNALS,
    ) -> None:
        self.signal = 0
        self._numbers = numbers
        self._before: dict[int, Any] = {}

    def __enter__(self) -> StopRequest:
        is_main = threading.current_thread() is threading.main_thread()
        for number in self._numbers if is_main else ():
            if number == signal.SIGHUP and signal.getsignal(number) is signal.SIG_IGN:
                continue
            self._before[number] = before = signal.signal(number, self._note)
            outer = getattr(before, '__self__', None)
            if isinstance(outer, StopRequest) and outer.signal:
                self._note(outer.signal, None)
        return self

    def __exit__(self, *error: object) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)

    def _note(self, number: int, frame: FrameType | None) -> None:
        self.signal = self.signal or number


@contextmanager
def defer_sigint() -> Iterator[None]:
    """Defer an interruption from the keyboard to the end of the block.

    Use it around imports, where a program may continue after an interruption: Python prints and
    ignores one in the import system's callbacks, and some packages, such as trimesh, mistake it for
    a missing dependency.
    """
    with StopRequest(numbers=(signal.SIGINT,)) as stop:
        yield
    if stop.signal:
        raise KeyboardInterrupt
