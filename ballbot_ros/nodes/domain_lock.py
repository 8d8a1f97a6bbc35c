"""One plant a ROS domain: it owns the domain's /clock."""

from __future__ import annotations

import fcntl
import os
import tempfile
from pathlib import Path

from ballbot_ros.errors import BallbotError


class DomainLock:
    """Held by a plant as long as it lives; the system releases it however the plant ends.

    It tells of plants on this machine at once. One on another machine is found by discovery,
    which takes its time.

    Parameters
    ----------
    domain : int
        The ROS domain.

    Raises
    ------
    BallbotError
        If another plant holds the lock.
    """

    def __init__(self, domain: int) -> None:
        path = Path(tempfile.gettempdir()) / f'ballbot_ros_plant_{domain}.lock'
        # Another user's file can be opened, but not created again.
        flags = os.O_RDONLY if path.exists() else os.O_RDONLY | os.O_CREAT
        self._file = os.open(path, flags, 0o644)
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            os.close(self._file)
            raise BallbotError(
                f'another plant is at work in ROS domain {domain}: wait for its end, or set '
                'ROS_DOMAIN_ID to another number'
            ) from None

    def release(self) -> None:
        """Let another plant have the domain."""
        os.close(self._file)
