"""A link through a serial device, such as ``/dev/rfcomm0`` or a pseudo-terminal."""

from __future__ import annotations

import fcntl
import os
import termios
import tty

from ballbot_ros.errors import TeleopError


def connect(path: str) -> int:
    """Open a serial device for raw bytes; return the file descriptor, which does not block.

    It is locked, as serial programs do, against a second one that would take half of the bytes.

    Raises
    ------
    OSError
        If it is absent, not accessible, or in use.
    TeleopError
        If it is no serial device.
    """
    device = os.open(path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK | os.O_CLOEXEC)
    try:
        fcntl.flock(device, fcntl.LOCK_EX | fcntl.LOCK_NB)
        tty.setraw(device)
    except termios.error:
        os.close(device)
        raise TeleopError(f'{path}: not a serial device') from None
    except OSError:
        os.close(device)
        raise
    return device


def is_pseudo(path: str) -> bool:
    """Return whether a device is a pseudo-terminal, which ends for good with its other side."""
    return path.startswith('/dev/pts/')
