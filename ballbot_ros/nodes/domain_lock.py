"""One plant, or player in its place, a ROS domain: it owns the domain's /clock."""

from __future__ import annotations

import fcntl
import os
import tempfile
from pathlib import Path

from ballbot_ros.errors import BallbotError

HANDED_ON = 'BALLBOT_DOMAIN_LOCK'
"""Environment variable: the file descriptor of a lock that the starting process handed on."""


class DomainLock:
    """Held by a plant as long as it lives; the system releases it however the plant ends.

    It tells of plants on this machine at once. One on another machine is found by discovery,
    which takes its time. A process that starts a plant takes the lock first and hands it on, so
    that no other plant can come between.

    Parameters
    ----------
    domain : int
        The ROS domain.

    Attributes
    ----------
    file : int
        Descriptor of the locked file.

    Raises
    ------
    BallbotError
        If another plant holds the lock.
    """

    def __init__(self, domain: int) -> None:
        if handed_on := os.environ.get(HANDED_ON):
            self.file = int(handed_on)
            return
        path = Path(tempfile.gettempdir()) / f'ballbot_ros_plant_{domain}.lock'
        # Another user's file can be opened, but not created again.
        flags = os.O_RDONLY if path.exists() else os.O_RDONLY | os.O_CREAT
        self.file = os.open(path, flags, 0o644)
        try:
            fcntl.flock(self.file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            os.close(self.file)
            raise BallbotError(
                f'another plant or player is at work in ROS domain {domain}: wait for its end, or '
                'set ROS_DOMAIN_ID to another number'
            ) from None

    def release(self) -> None:
        """Let another plant have the domain."""
        os.close(self.file)
