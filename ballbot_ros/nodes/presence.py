"""Who is in a ROS domain on this machine: its plant, and its participants.

Each participant of a domain has a number, which determines its ports (RTPS 2.5, 9.6.2.3).
"""

from __future__ import annotations

import errno
import hashlib
import os
import re
import socket
from pathlib import Path

from ballbot_ros.errors import BallbotError
from ballbot_ros.lockstep.participants import LocalNode

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


PORT_BASE, PORTS_PER_DOMAIN, PORTS_PER_PARTICIPANT = 7400, 250, 2
DISCOVERY_PORT, USER_PORT = 10, 11
"""Offsets of a participant's own ports from the base port of its domain."""


_READING_SIZES = 31 * 128, 29 * 128, 23 * 128


def _sockets(table: str) -> set[str]:
    """Return the lines of a table of the system: ``udp`` or ``unix``.

    The system counts off the sockets for each part that is read, so one that is closed meanwhile
    hides that with which the next part begins. Other sizes of the parts show the hidden one.
    """
    return {line for size in _READING_SIZES for line in _read_sockets(table, size)}


def _read_sockets(table: str, size: int) -> list[str]:
    """Return the lines of a table, read in parts of a size [byte]."""
    with Path('/proc/net', table).open('rb', buffering=0) as file:
        return (
            b''.join(iter(lambda: file.read(size), b'')).decode(errors='replace').splitlines()[1:]
        )


def bound_udp_ports() -> set[int]:
    """Return the UDP ports (IPv4) that processes on this machine have bound."""
    return {int(line.split()[1].rpartition(':')[2], 16) for line in _sockets('udp')}


def living_participants(domain: int) -> list[int]:
    """Return the numbers of a domain's participants on this machine.

    A participant binds two ports. Other programs may be assigned one of them beyond domain 101.
    """
    bound = bound_udp_ports()
    base = PORT_BASE + PORTS_PER_DOMAIN * domain
    firsts = range(base + DISCOVERY_PORT, base + PORTS_PER_DOMAIN, PORTS_PER_PARTICIPANT)
    to_user = USER_PORT - DISCOVERY_PORT
    return [number for number, port in enumerate(firsts) if {port, port + to_user} <= bound]


_NAME = 'ballbot_ros_participant_{domain}_{namespace}_{role}_{process}_{instance}'


class Presence:
    """Shows that a participant lives; the system removes it however its process ends.

    Like :class:`~ballbot_ros.nodes.presence.DomainLock` it is a Unix socket with an abstract
    name.
    """

    def __init__(self, domain: int, namespace: str, role: str, instance: str) -> None:
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._socket.bind('\0' + _name(domain, namespace, role, str(os.getpid()), instance))

    def close(self) -> None:
        """Remove it."""
        self._socket.close()


def present_nodes(domain: int, namespace: str) -> dict[str, LocalNode]:
    """Return the participants on this machine in a domain and namespace, by their instances."""
    pattern = f'@{_name(domain, namespace, "([a-z_]+)", "([0-9]+)", "([0-9a-f]+)")}$'
    found = (re.search(pattern, line) for line in _sockets('unix'))
    return {each[3]: LocalNode(each[1], int(each[2])) for each in found if each}


def _name(domain: int, namespace: str, role: str, process: str, instance: str) -> str:
    # The name of a socket has at most 107 bytes, and a namespace may be longer.
    short = hashlib.sha256(namespace.encode()).hexdigest()[:8]
    return _NAME.format(
        domain=domain, namespace=short, role=role, process=process, instance=instance
    )
