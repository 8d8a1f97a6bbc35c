"""The shared memory ports that this process reads, and their repair.

Fast DDS (2.14) removes the port of a process that it considers dead, sometimes wrongly. If several
processes test a lock file at once, they can remove the port of a living reader; if the machine
stalls a process for seconds, two processes may open a port at the same time. The reader then keeps
reading a deleted file, and receives nothing from processes that open the port later.
"""

from __future__ import annotations

import os
import re
from contextlib import suppress
from pathlib import Path

from ballbot_ros.nodes.port_readers import find_reader_states
from ballbot_ros.nodes.shared_memory import SHARED_MEMORY

_OWN_LOCK = re.compile(rf'{SHARED_MEMORY}/(fastrtps_port(\d+))_el(?: \(deleted\))?')
_REMOVED_PORT = re.compile(
    rf'([0-9a-f]+)-([0-9a-f]+) rw-s .* {SHARED_MEMORY}/(fastrtps_port\d+) \(deleted\)'
)
_FLAGS_TO_READERS, _NUMBER_TO_FLAGS = 20588, 24
"""Distances in the state of a port [bytes], for the layout on x86-64: from the flags to the states
of the readers, and from the port's number to the flags."""

_IS_OK = 1


class OwnPorts:
    """Keeps the ports of this process open for others."""

    def __init__(self) -> None:
        self._intact: dict[str, int] = {}

    def repair(self) -> None:
        """Make Fast DDS reopen the ports of this process that others have removed."""
        numbers = _own_ports()
        inodes = {name: _inode(name) for name in numbers}
        if inodes == self._intact:
            return
        removed = _find_removed_ports(numbers)
        if removed:
            # Access the ports through this file: there an address that is no longer mapped causes
            # an error, not a crash.
            with Path('/proc/self/mem').open('r+b', buffering=0) as memory:
                for name, start, size in removed:
                    with suppress(OSError):
                        _mark_as_broken(memory.fileno(), start, size, numbers[name])
        self._intact = {} if removed else inodes


def _own_ports() -> dict[str, int]:
    """Return the ports whose lock this process holds: numbers by name."""
    found = {}
    for link in Path('/proc/self/fd').iterdir():
        with suppress(OSError):  # closed in the meantime
            if match := _OWN_LOCK.fullmatch(str(link.readlink())):
                found[match[1]] = int(match[2])
    return found


def _inode(name: str) -> int:
    """Return the inode of a port's current file; 0 if there is none."""
    try:
        return (SHARED_MEMORY / name).stat().st_ino
    except OSError:
        return 0


def _find_removed_ports(numbers: dict[str, int]) -> list[tuple[str, int, int]]:
    """Return name, address and size of the mapped ports whose file has been removed."""
    matches = _REMOVED_PORT.finditer(Path('/proc/self/maps').read_text())
    mapped = [(match[3], int(match[1], 16), int(match[2], 16)) for match in matches]
    return [(name, start, end - start) for name, start, end in mapped if name in numbers]


def _mark_as_broken(memory: int, start: int, size: int, number: int) -> None:
    """Mark a mapped port as broken, so that its reader reopens it."""
    readers = find_reader_states(os.pread(memory, size, start))
    if readers is None:
        return
    flags = start + readers - _FLAGS_TO_READERS
    if os.pread(memory, 4, flags - _NUMBER_TO_FLAGS) == number.to_bytes(4, 'little'):
        (byte,) = os.pread(memory, 1, flags)
        os.pwrite(memory, bytes([byte & ~_IS_OK]), flags)
