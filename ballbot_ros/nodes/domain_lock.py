"""One plant, or player in its place, a ROS domain: it owns the domain's /clock."""

from __future__ import annotations

import errno
import os
import socket

from ballbot_ros.errors import BallbotError

LOCK_FD_ENV = 'BALLBOT_DOMAIN_LOCK'
"""Environment variable: the file descriptor of a lock that the starting process handed on."""


class DomainLock:
    """Held by a plant as long as it lives; the system releases it however the plant ends.

    It tells of plants on this machine at once, whichever user's they are. One on another machine
    is found by discovery, which takes its time. A process that starts a plant takes the lock
    first and hands it on, so that no other plant can come between.

    It is a Unix socket with an abstract name. That has no place in the file system, where its
    folder would follow from a terminal's environment and somebody else could lay another file in
    its way; and it holds where the middleware's ports do, within a network namespace.

    Parameters
    ----------
    domain : int
        The ROS domain.

    Attributes
    ----------
    file : int
        Descriptor of the socket.

    Raises
    ------
    BallbotError
        If another plant holds the lock.
    """

    def __init__(self, domain: int) -> None:
        if handed_on := os.environ.get(LOCK_FD_ENV):
            self.file = int(handed_on)
            return
        with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as name:
            try:
                name.bind(f'\0ballbot_ros_plant_{domain}')
            except OSError as error:
                if error.errno != errno.EADDRINUSE:
                    raise
                raise BallbotError(
                    f'another plant or player is at work in ROS domain {domain}: wait for its end, '
                    'or set ROS_DOMAIN_ID to another number'
                ) from None
            self.file = name.detach()

    def release(self) -> None:
        """Let another plant have the domain."""
        os.close(self.file)
