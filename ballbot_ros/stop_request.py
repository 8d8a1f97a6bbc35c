"""Signals as a request instead of an interruption."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from types import FrameType
from typing import Any

STOP_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


class StopRequest:
    """Within the block, signals are noted instead of interrupting; a loop looks at them.

    Nothing is done in the handler, which may come in the midst of anything: a lock that it needs
    may be held by what it interrupts. What a block around it has noted before counts within it,
    too. A hangup that is ignored, as ``nohup`` has it, still is. Only the main thread can note
    signals; a block in another one notes none.

    Parameters
    ----------
    numbers : sequence of int
        The signals.

    Attributes
    ----------
    signal : int
        The signal that came, or 0.
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
    """Let an interruption from the keyboard within the block count at its end.

    For imports: an interruption of a callback of Python's import system is printed and forgotten,
    and trimesh, for one, takes one for a part that is missing. The program would go on.
    """
    with StopRequest(numbers=(signal.SIGINT,)) as stop:
        yield
    if stop.signal:
        raise KeyboardInterrupt
