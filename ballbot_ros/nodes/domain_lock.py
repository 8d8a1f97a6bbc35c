"""The lock on a ROS domain: one plant, or a player in its place, owns the domain's /clock."""

from __future__ import annotations

import errno
import os
import socket

from ballbot_ros.errors import BallbotError

LOCK_FD_ENV = 'BALLBOT_DOMAIN_LOCK'
"""Environment variable: file descriptor of a lock inherited from the starting process."""


class DomainLock:
    """Lock held for the lifetime of a plant; the system releases it however the plant ends.

    It detects plants of any user on this machine at once; plants on other machines are found by
    discovery, which takes time. A process that starts a plant takes the lock first and passes it
    on, so that no other plant can start in between.

    It is a Unix socket with an abstract name. Such a name has no place in the file system, so it
    does not depend on environment variables and no file can be in its way. Its scope is the network
    namespace, which is also that of the middleware's ports.

    Attributes
    ----------
    file : int
        Descriptor of the socket.

    Raises
    ------
    BallbotError
        If another plant or player holds the lock.
    """

    def __init__(self, domain: int) -> None:
        if inherited_fd := os.environ.get(LOCK_FD_ENV):
            self.file = int(inherited_fd)
            return
        with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as name:
            try:
                name.bind(f'\0ballbot_ros_plant_{domain}')
            except OSError as error:
                if error.errno != errno.EADDRINUSE:
                    raise
                raise BallbotError(
                    f'another plant or player is running in ROS domain {domain}: wait for its end, '
                    'or set ROS_DOMAIN_ID to another number'
                ) from None
            self.file = name.detach()

    def __enter__(self) -> DomainLock:
        return self

    def __exit__(self, *error: object) -> None:
        self.release()

    def release(self) -> None:
        """Release the domain for another plant."""
        os.close(self.file)
