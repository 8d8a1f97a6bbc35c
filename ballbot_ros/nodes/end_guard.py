"""Ends a process that no signal can end, because a call of the middleware does not return.

Python's handlers of signals wait for the end of such a call. But the interpreter also writes the
number of a signal to a file, at once, and another process, which this file is the program of, reads
it there.
"""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

LIMIT_S = 2.0
"""Time for which the main thread may be in one and the same wait after a signal [s]."""

_POLL_S = 0.05


@contextmanager
def guarded_end() -> Iterator[None]:
    """Context in which this process is killed if its main thread does not react to a signal."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    # Imported here: as a program, this file has no packages.
    from ballbot_ros.process import STOP_SIGNALS

    ours, theirs = socket.socketpair()
    with ours:
        with theirs:
            guard = subprocess.Popen(
                [sys.executable, '-IS', __file__, *(str(int(each)) for each in STOP_SIGNALS)],
                stdin=theirs.fileno(),
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                start_new_session=True,
            )
        ours.setblocking(False)
        before = signal.set_wakeup_fd(ours.fileno(), warn_on_full_buffer=False)
        try:
            yield
        finally:
            signal.set_wakeup_fd(before)
            guard.kill()
            guard.wait()


def main() -> None:
    """Wait for one of the given signals to the parent; kill it if its main thread then hangs."""
    parent = os.getppid()
    awaited = {int(number) for number in sys.argv[1:]}
    while not awaited.intersection(number := os.read(sys.stdin.fileno(), 1)):
        if not number:
            return
    wait, since = '', time.monotonic()
    while os.getppid() == parent:
        last, wait = wait, _wait_of(parent)
        if not wait or wait != last:
            since = time.monotonic()
        elif time.monotonic() - since > LIMIT_S:
            os.kill(parent, signal.SIGKILL)
            return
        time.sleep(_POLL_S)


def _wait_of(process: int) -> str:
    """Return what tells a wait of the main thread from its other waits; '' if it does not wait.

    Nor does it if it lacks a processor, if the process is stopped, or if a thread waits for a disk.
    """
    main_state, wait = '', ''
    for thread in Path(f'/proc/{process}/task').iterdir():
        with suppress(OSError):  # it has just ended
            lines = (thread / 'status').read_text(encoding='utf-8').splitlines()
            status = dict(line.split(':\t', 1) for line in lines)
            state = status['State'][0]
            if state == 'D':
                return ''
            if int(thread.name) == process:
                main_state, wait = state, status['voluntary_ctxt_switches']
    return wait if main_state == 'S' else ''


if __name__ == '__main__':
    with suppress(OSError):
        main()
