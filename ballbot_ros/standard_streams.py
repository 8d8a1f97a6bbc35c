"""Standard streams: opened if they are closed, as by a daemon; kept for the result."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager


def open_standard_streams() -> None:
    """Open closed standard streams on the null device.

    Otherwise the next file to be opened, such as a recording, would get the file descriptor of a
    standard stream, and the output of libraries would end up in it.
    """
    for name, mode in (('stdin', 'r'), ('stdout', 'w'), ('stderr', 'w')):
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, mode, encoding='utf-8'))  # noqa: PTH123, SIM115


@contextmanager
def stdout_to_stderr() -> Iterator[None]:
    """Keep stdout for the result: redirect what middleware and controllers print to stderr."""
    sys.stdout.flush()
    kept = os.dup(1)
    os.dup2(2, 1)
    try:
        yield
    finally:
        os.dup2(kept, 1)
        os.close(kept)
