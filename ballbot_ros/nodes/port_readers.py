"""The states of a port's readers in shared memory, as Fast DDS (2.14) lays them out."""

from __future__ import annotations

import re
from contextlib import suppress
from pathlib import Path

PORT_HEADER = 1024 * 64
"""Size of the part of a port that includes the states of its readers."""

READERS, READER_SIZE = 1024, 20
AFTER_READERS = b'fastrtps\0'
"""Content of a port after the states of its readers."""

WAITS = b'\3'
"""First byte of the state of a reader that waits for a message."""

_DOES_NOT_WAIT = re.compile(rb'[\1\5]')  # bits: 1 in use, 2 waits, 4 takes a message


def find_reader_states(port: bytes) -> int | None:
    """Return the offset of the readers' states in a port; None if its layout is unknown."""
    end = port.find(AFTER_READERS, READERS * READER_SIZE)
    return None if end < 0 else end - READERS * READER_SIZE


def find_idle_readers(path: Path) -> list[int]:
    """Return the offsets of the states of readers that do not wait for a message."""
    try:
        with path.open('rb', buffering=0) as file:
            port = file.read(PORT_HEADER)
    except OSError:  # removed, or another user's
        return []
    first = find_reader_states(port)
    if first is None:
        return []
    states = port[first : first + READERS * READER_SIZE : READER_SIZE]
    return [first + READER_SIZE * match.start() for match in _DOES_NOT_WAIT.finditer(states)]


def mark_as_waiting(path: Path) -> None:
    """Mark the idle readers of a port as waiting."""
    with suppress(OSError), path.open('r+b', buffering=0) as port:
        for state in find_idle_readers(path):
            port.seek(state)
            port.write(WAITS)
