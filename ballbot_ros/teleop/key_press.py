"""Waiting for a key in the terminal."""

from __future__ import annotations

import os
import select
import termios
import tty
from collections.abc import Callable
from contextlib import suppress
from threading import Lock, Thread
from typing import Any

STDIN = 0


def can_read_keys() -> bool:
    """Return whether standard input is a terminal, and this process in its foreground."""
    try:
        return os.tcgetpgrp(STDIN) == os.getpgrp()
    except OSError:
        return False


class KeyPress:
    """Calls `on_key` on its own thread when a key is pressed for the first time.

    Until then or until it is closed, the terminal shows no keys that are typed; Ctrl-C remains.
    Nothing happens without a terminal.
    """

    def __init__(self, on_key: Callable[[], None]) -> None:
        self._on_key = on_key
        self._lock = Lock()
        self._modes: list[Any] | None = None
        self._end, self._end_side = os.pipe()
        self._thread = Thread(target=self._wait, name='key press', daemon=True)
        if can_read_keys():
            self._modes = termios.tcgetattr(STDIN)
            # Not the default, which would drop a key that was pressed a moment before.
            tty.setcbreak(STDIN, termios.TCSADRAIN)
            self._thread.start()

    def _wait(self) -> None:
        readable, _, _ = select.select([STDIN, self._end], [], [])
        if self._end in readable:
            return
        with suppress(OSError):  # the terminal has disappeared
            if os.read(STDIN, 1024):
                self._on_key()
        self._restore()

    def _restore(self) -> None:
        with self._lock, suppress(termios.error):
            if self._modes is not None:
                termios.tcsetattr(STDIN, termios.TCSADRAIN, self._modes)
            self._modes = None

    def close(self) -> None:
        """Stop waiting, and restore the terminal."""
        if self._end_side < 0:
            return
        os.close(self._end_side)
        self._end_side = -1
        if self._thread.is_alive():
            self._thread.join()
        os.close(self._end)
        self._restore()
