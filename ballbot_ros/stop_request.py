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
    """Within the block, signals are noted instead of interrupting; a loop checks for them.

    Nothing else happens in the handler, which may interrupt anything, including the owner of a lock
    that it would need. A signal noted by an enclosing block counts here, too. An ignored hangup, as
    with ``nohup``, stays ignored. Only the main thread can note signals.

    Parameters
    ----------
    numbers : sequence of int
        The signals.

    Attributes
    ----------
    signal : int
        The signal that arrived, or 0.
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

    For imports: Python prints and ignores an interruption of the import system's callbacks, and
    some packages, such as trimesh, mistake it for a missing dependency. The program would continue.
    """
    with StopRequest(numbers=(signal.SIGINT,)) as stop:
        yield
    if stop.signal:
        raise KeyboardInterrupt
