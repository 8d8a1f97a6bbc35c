"""Shows the participants of runs to all processes of this machine, before they are discovered."""

from __future__ import annotations

import hashlib
import os
import re
import socket
from pathlib import Path

from ballbot_ros.simulation.participants import LocalNode

_NAME = 'ballbot_ros_participant_{domain}_{namespace}_{role}_{process}_{instance}'


class Presence:
    """Shows that a participant lives; the system removes it however its process ends.

    Like :class:`~ballbot_ros.nodes.domain_lock.DomainLock` it is a Unix socket with an abstract
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
    found = re.findall(pattern, Path('/proc/net/unix').read_text(), re.MULTILINE)
    return {instance: LocalNode(role, int(process)) for role, process, instance in found}


def _name(domain: int, namespace: str, role: str, process: str, instance: str) -> str:
    # The name of a socket has at most 107 bytes, and a namespace may be longer.
    short = hashlib.sha256(namespace.encode()).hexdigest()[:8]
    return _NAME.format(
        domain=domain, namespace=short, role=role, process=process, instance=instance
    )
