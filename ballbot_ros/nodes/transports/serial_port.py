"""A link through a serial device, such as ``/dev/rfcomm0`` or a pseudo-terminal."""

from __future__ import annotations

import fcntl
import os
import termios
import tty


def connect(path: str) -> int:
    """Open a serial device for raw bytes; return the file descriptor, which does not block.

    It is locked, as serial programs do, against a second one that would take half of the bytes.

    Raises
    ------
    OSError
        If it is absent, not accessible, in use, or no serial device.
    """
    device = os.open(path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK | os.O_CLOEXEC)
    try:
        fcntl.flock(device, fcntl.LOCK_EX | fcntl.LOCK_NB)
        tty.setraw(device)
    except (termios.error, OSError) as error:
        os.close(device)
        raise OSError(error.args[0], error.args[1]) from None
    return device
