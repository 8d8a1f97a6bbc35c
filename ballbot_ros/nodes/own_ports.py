"""The shared memory ports that this process reads, and their repair.

Fast DDS (2.14) takes a port for that of a dead process if its lock file exists and is not locked.
It tests that by locking the file, and then removes the file. If several processes test at once, as
they do after a reader was stopped or starved for a second, a living reader may lose its lock file
and then its port. It reads on from the removed file, deaf to everybody who opens the port later.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

from ballbot_ros.nodes.shared_memory import SHARED_MEMORY, find_reader_states

_LOST_LOCK = re.compile(rf'{SHARED_MEMORY}/(fastrtps_port(\d+))_el \(deleted\)')
_FLAGS_TO_READERS, _NUMBER_TO_FLAGS = 20588, 24
"""Distances in the state of a port [bytes]; the layout is that of x86-64."""

_IS_OK = 1


def repair_own_ports() -> None:
    """Have Fast DDS reopen the ports of this process whose lock file was removed by others."""
    lost = dict(_lost_ports())
    if not lost:
        return
    memory = os.open('/proc/self/mem', os.O_RDWR)  # an error, not a crash, where nothing is mapped
    try:
        for line in Path('/proc/self/maps').read_text().splitlines():
            addresses, _, _, _, _, *path = line.split(maxsplit=5)
            name = Path(path[0]).name.removesuffix(' (deleted)') if path else ''
            if name in lost:
                start, end = (int(address, 16) for address in addresses.split('-'))
                with suppress(OSError):  # unmapped by now
                    _mark_as_broken(memory, start, end - start, lost[name])
    finally:
        os.close(memory)


def _lost_ports() -> Iterator[tuple[str, int]]:
    """Return the ports whose lock this process holds on a file that is gone: name and number."""
    for link in Path('/proc/self/fd').iterdir():
        with suppress(OSError):  # closed by now
            if match := _LOST_LOCK.fullmatch(str(link.readlink())):
                yield match[1], int(match[2])


def _mark_as_broken(memory: int, start: int, size: int, number: int) -> None:
    """Mark a mapped port as broken, so that its reader reopens it."""
    readers = find_reader_states(os.pread(memory, size, start))
    if readers is None:
        return
    flags = start + readers - _FLAGS_TO_READERS
    if os.pread(memory, 4, flags - _NUMBER_TO_FLAGS) == number.to_bytes(4, 'little'):
        (byte,) = os.pread(memory, 1, flags)
        os.pwrite(memory, bytes([byte & ~_IS_OK]), flags)
