"""The participants of a domain on this machine, by the UDP ports that they have bound.

Each participant of a domain has a number, which determines its ports (RTPS 2.5, 9.6.2.3).
"""

from __future__ import annotations

from pathlib import Path

PORT_BASE, PORTS_PER_DOMAIN, PORTS_PER_PARTICIPANT = 7400, 250, 2
DISCOVERY_PORT, USER_PORT = 10, 11
"""Offsets of a participant's own ports from the base port of its domain."""


def bound_udp_ports() -> set[int]:
    """Return the UDP ports (IPv4) that processes on this machine have bound."""
    lines = Path('/proc/net/udp').read_text().splitlines()[1:]
    return {int(line.split()[1].rpartition(':')[2], 16) for line in lines}


def living_participants(domain: int) -> list[int]:
    """Return the numbers of a domain's participants on this machine.

    A participant binds two ports. Other programs may be assigned one of them beyond domain 101.
    """
    bound = bound_udp_ports()
    base = PORT_BASE + PORTS_PER_DOMAIN * domain
    firsts = range(base + DISCOVERY_PORT, base + PORTS_PER_DOMAIN, PORTS_PER_PARTICIPANT)
    to_user = USER_PORT - DISCOVERY_PORT
    return [number for number, port in enumerate(firsts) if {port, port + to_user} <= bound]
