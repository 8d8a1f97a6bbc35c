"""Standard streams for a program that is started without, as by a daemon."""

from __future__ import annotations

import os
import sys


def open_standard_streams() -> None:
    """Open those of standard input, output and error that are closed, on nothing.

    Each gets the lowest number that is free, its own. The next file would have got it, such as a
    recording, and whatever a library prints would stand in there.
    """
    for name, mode in (('stdin', 'r'), ('stdout', 'w'), ('stderr', 'w')):
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, mode, encoding='utf-8'))  # noqa: PTH123, SIM115
