"""Keeps a new participant off the ports of one that was killed.

Each participant of a domain has a number, and ports by it (RTPS 2.5, 9.6.2.3). Fast DDS (2.14)
takes the lowest number that is free, in shared memory, too. A process that writes to a killed
participant's port keeps it open, and finds out only after seconds that nobody reads there; if the
participant was killed just while it read, never, as only waiting readers are watched. A participant
that takes the number meanwhile hears nothing from this process.
"""

from __future__ import annotations

import socket
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from itertools import islice
from pathlib import Path

from ballbot_ros.nodes.shared_memory import SHARED_MEMORY, find_stale_ports

PORT_BASE, PORTS_PER_DOMAIN, PORTS_PER_PARTICIPANT = 7400, 250, 2
DISCOVERY_PORT, USER_PORT = 10, 11
"""Offsets of a participant's own ports, from that of its domain."""

MOST_AVOIDED = 16
"""Half of the numbers at which participants on one machine look for each other."""


def stale_participants(domain: int, folder: Path = SHARED_MEMORY) -> list[int]:
    """Return the numbers of a domain's participants that have died and left their port."""
    first = PORT_BASE + PORTS_PER_DOMAIN * domain + USER_PORT
    ports = range(first, first - USER_PORT + PORTS_PER_DOMAIN, PORTS_PER_PARTICIPANT)
    return sorted(ports.index(port) for port in find_stale_ports(folder) if port in ports)


@contextmanager
def avoid_stale_ports(domain: int, folder: Path = SHARED_MEMORY) -> Iterator[None]:
    """Have a participant that begins within the block take another number.

    Their ports for discovery are held meanwhile: Fast DDS then tries the next number.

    Parameters
    ----------
    domain : int
        The ROS domain.
    folder : Path
    """
    first = PORT_BASE + PORTS_PER_DOMAIN * domain + DISCOVERY_PORT
    with ExitStack() as held:
        for number in islice(stale_participants(domain, folder), MOST_AVOIDED):
            holder = held.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
            # Processes that start at the same time hold it together; Fast DDS does not share it.
            holder.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            with suppress(OSError):  # in use already
                holder.bind(('', first + PORTS_PER_PARTICIPANT * number))
        yield
