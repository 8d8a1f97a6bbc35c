"""A pseudo terminal held by a test, and its output."""

import contextlib
import fcntl
import os
import pty
import re
import struct
import subprocess
import termios
import threading
import time

import pyte
from graph import wait_for

REPEAT_S = 0.1


def take_terminal():
    """Make standard input the terminal of this process, as a shell does."""
    os.setsid()
    fcntl.ioctl(0, termios.TIOCSCTTY, 0)


class Terminal:
    """A pseudo terminal of 24 by 100 characters, whose `side` is for a process.

    `screen` is all that was written to it; :meth:`shown` is what a user sees.
    """

    def __init__(self):
        self._ours, self.side = pty.openpty()
        fcntl.ioctl(self.side, termios.TIOCSWINSZ, struct.pack('HHHH', 24, 100, 0, 0))
        self.screen = b''
        self._seen = pyte.Screen(100, 24)
        self._stream = pyte.ByteStream(self._seen)
        self._lock = threading.Lock()
        threading.Thread(target=self._read, daemon=True).start()

    def _read(self):
        with contextlib.suppress(OSError):
            while data := os.read(self._ours, 4096):
                with self._lock:
                    self.screen += data
                    self._stream.feed(data)

    def start(self, words, **environment):
        """Start a program in the foreground of the terminal; return the process."""
        return subprocess.Popen(
            words,
            env=environment | {'TERM': 'xterm'},
            stdin=self.side,
            stdout=self.side,
            stderr=self.side,
            preexec_fn=take_terminal,  # noqa: PLW1509
        )

    def press(self, keys):
        os.write(self._ours, keys)

    def shown(self):
        """Return the lines on the screen."""
        with self._lock:
            return [line.rstrip() for line in self._seen.display]

    def wait_until_shown(self, text):
        wait_for(lambda: any(text in line for line in self.shown()), what=f'{text!r} on the screen')

    def press_until_shown(self, keys, text):
        """Press keys again and again, as a key that is held down: each acts only for a moment."""

        def is_shown():
            self.press(keys)
            time.sleep(REPEAT_S)
            return any(text in line for line in self.shown())

        wait_for(is_shown, what=f'{text!r} on the screen')

    def wait_for_text(self, text, since=0):
        wait_for(lambda: text in self.screen[since:], what=f'{text!r} on the screen')

    def wait_for_match(self, pattern, since=0):
        wait_for(
            lambda: re.search(pattern.encode(), self.screen[since:]),
            what=f'{pattern!r} on the screen',
        )

    def hang_up(self):
        os.close(self._ours)
