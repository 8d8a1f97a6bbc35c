"""Keeps a new participant off the ports of a killed one.

Each participant of a domain has a number, which determines its ports (RTPS 2.5, 9.6.2.3). Fast DDS
(2.14) takes the lowest free number, and uses it for the ports in shared memory, too. A process that
writes to the port of a killed participant keeps the port open, and notices only after seconds that
nobody reads it. If the participant was killed while reading, the writing process never notices,
since only waiting readers are monitored. A new participant with the same number then receives
nothing from that process.
"""

from __future__ import annotations

import socket
from collections.abc import Collection, Iterator
from contextlib import ExitStack, contextmanager, suppress
from itertools import islice
from pathlib import Path

from ballbot_ros.nodes.shared_memory import SHARED_MEMORY, find_stale_ports

PORT_BASE, PORTS_PER_DOMAIN, PORTS_PER_PARTICIPANT = 7400, 250, 2
DISCOVERY_PORT, USER_PORT = 10, 11
"""Offsets of a participant's own ports from the base port of its domain."""

MAX_AVOIDED_PARTICIPANTS = 16
"""Half of the numbers under which participants on one machine look for each other."""


def bound_udp_ports() -> set[int]:
    """Return the UDP ports (IPv4) that processes on this machine have bound."""
    lines = Path('/proc/net/udp').read_text().splitlines()[1:]
    return {int(line.split()[1].rpartition(':')[2], 16) for line in lines}


def living_participants(domain: int) -> list[int]:
    """Return the numbers of a domain's participants on this machine.

    A participant binds two ports. Other programs may be assigned one of them beyond domain 101.
    """
    bound = bound_udp_ports()
    discovering = _participants(domain, DISCOVERY_PORT, bound)
    return [number for number in _participants(domain, USER_PORT, bound) if number in discovering]


def stale_participants(domain: int, folder: Path = SHARED_MEMORY) -> list[int]:
    """Return the numbers of a domain's dead participants that have left their ports."""
    return _participants(domain, USER_PORT, find_stale_ports(folder))


def _participants(domain: int, offset: int, ports: Collection[int]) -> list[int]:
    """Return the numbers of a domain's participants whose port at `offset` is in `ports`."""
    base = PORT_BASE + PORTS_PER_DOMAIN * domain
    own_ports = range(base + offset, base + PORTS_PER_DOMAIN, PORTS_PER_PARTICIPANT)
    return [number for number, port in enumerate(own_ports) if port in ports]


@contextmanager
def avoid_stale_ports(domain: int, folder: Path = SHARED_MEMORY) -> Iterator[None]:
    """Keep participants that start within the block off the numbers of killed ones.

    The discovery ports of these numbers are occupied meanwhile, so that Fast DDS tries the next
    number.
    """
    first = PORT_BASE + PORTS_PER_DOMAIN * domain + DISCOVERY_PORT
    with ExitStack() as held:
        for number in islice(stale_participants(domain, folder), MAX_AVOIDED_PARTICIPANTS):
            holder = held.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
            # Share the port with processes that start at the same time; Fast DDS does not share it.
            holder.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            with suppress(OSError):  # already in use
                holder.bind(('', first + PORTS_PER_PARTICIPANT * number))
        yield
