"""Signals as requests to stop, standard streams, and showing progress."""

from __future__ import annotations

import os
import signal
import sys
import threading
import time
from _thread import start_new_thread
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from io import BufferedWriter, FileIO, TextIOWrapper
from types import FrameType
from typing import Any

STOP_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)

_AGAIN_S = 0.01


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
    and while the interpreter ends, signals have no effect: the program is already ending. Python
    ignores the exception in a finalizer or the callback of a weak reference: the signal is then
    sent once more, and so it is if it comes before Python is done with that.
    """

    def __enter__(self) -> ProgramEnd:
        self._unraisable = sys.unraisablehook
        sys.unraisablehook = self._on_unraisable
        super().__enter__()
        return self

    def __exit__(self, *error: object) -> None:
        for number in self._before:
            signal.signal(number, signal.SIG_IGN)
        sys.unraisablehook = self._unraisable

    def _on_signal(self, number: int, frame: FrameType | None) -> None:
        if self.signal:
            return
        if self._handles_unraisable(frame):
            _send_again(number)
            return
        self.signal = number
        raise _Interrupt if number == signal.SIGINT else _End(128 + number)

    def _on_unraisable(self, unraisable: sys.UnraisableHookArgs) -> None:
        if not isinstance(unraisable.exc_value, _Interrupt | _End):
            self._unraisable(unraisable)
            return
        number, self.signal = self.signal, 0
        _send_again(number)

    def _handles_unraisable(self, frame: FrameType | None) -> bool:
        """Return whether a frame belongs to the hook, in which an exception would be ignored."""
        while frame and frame.f_code is not ProgramEnd._on_unraisable.__code__:
            frame = frame.f_back
        return frame is not None


def _send_again(number: int) -> None:
    """Send a signal to this process a little later, from a thread."""

    def send() -> None:
        time.sleep(_AGAIN_S)
        os.kill(os.getpid(), number)

    # Not one of `threading`, which waits for its start: this one may come from a signal handler.
    start_new_thread(send, ())


class _Interrupt(KeyboardInterrupt):
    """The end of a program by SIGINT."""


class _End(SystemExit):
    """The end of a program by another signal."""


def open_standard_streams() -> None:
    """Open closed standard streams on the null device.

    Otherwise the next file to be opened, such as a recording, would get the file descriptor of a
    standard stream, and the output of libraries would end up in it.
    """
    for name, mode in (('stdin', 'r'), ('stdout', 'w'), ('stderr', 'w')):
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, mode, encoding='utf-8'))  # noqa: PTH123, SIM115


STANDARD_OUTPUT = 'standard output'
"""The name of the file in errors."""


class _StandardOutput(FileIO):
    """Standard output whose errors name it, as those of other files do."""

    def write(self, data: Any) -> int:
        try:
            return super().write(data)
        except OSError as error:
            error.filename = STANDARD_OUTPUT
            raise


def prepare_standard_output() -> None:
    r"""Let errors of standard output name it, and let it escape what its encoding lacks.

    Characters that a terminal or file can't encode, such as θ in ASCII, become ``\u03b8``.
    """
    stdout = sys.stdout
    if stdout is sys.__stdout__ and isinstance(stdout, TextIOWrapper) and stdout.fileno() == 1:
        file = _StandardOutput(1, 'w', closefd=False)
        sys.stdout = TextIOWrapper(
            file if stdout.write_through else BufferedWriter(file), stdout.encoding,
            line_buffering=stdout.line_buffering, write_through=stdout.write_through,
        )  # fmt: skip
    if isinstance(sys.stdout, TextIOWrapper):
        sys.stdout.reconfigure(errors='backslashreplace')


@contextmanager
def stdout_to_stderr() -> Iterator[None]:
    """Keep stdout for the result: redirect what middleware and controllers print to stderr."""
    sys.stdout.flush()
    kept = os.dup(1)
    os.dup2(2, 1)
    try:
        yield
    finally:
        sys.stdout.flush()
        os.dup2(kept, 1)
        os.close(kept)


ProgressCallback = Callable[[int, int], None]
"""Called with the amount done and the total."""

PROGRESS_PERIOD_S = 0.2
"""Update interval of a progress display in wall time [s]."""
