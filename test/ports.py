"""The ports of Fast DDS 2.14 in shared memory, for tests that break them."""

import ctypes
import mmap
import platform
import re
from pathlib import Path

import pytest

from ballbot_ros.nodes.port_readers import AFTER_READERS, READER_SIZE, READERS
from ballbot_ros.nodes.shared_memory import SHARED_MEMORY

LIBC = ctypes.CDLL(None)

needs_layout_of_ports = pytest.mark.skipif(
    platform.machine() != 'x86_64', reason="the ports' layout is that of x86-64"
)


class Port(ctypes.Structure):
    """The beginning of a port, up to the state of its first reader."""

    _fields_ = [
        ('readers_checked_ms', ctypes.c_int64),
        ('_counts', ctypes.c_uint32 * 9),
        ('flags', ctypes.c_uint32),
        ('_condition', ctypes.c_char * 20544),
        ('lock', ctypes.c_int32),
        ('_recursion', ctypes.c_int32),
        ('owner', ctypes.c_int32),
        ('_mutex', ctypes.c_int32 * 7),
        ('first_reader', ctypes.c_uint8),
    ]

    @property
    def mutex(self):
        return ctypes.byref(self, Port.lock.offset)


def find_data_port(process):
    """Return the file of the port from which a process reads data.

    The ports for discovery, from 7000 on, are common to all domains.
    """
    links = [str(link.readlink()) for link in Path(f'/proc/{process}/fd').iterdir()]
    lock = re.compile(rf'{SHARED_MEMORY}/fastrtps_port(\d+)_el')
    number = max(int(match[1]) for link in links if (match := lock.fullmatch(link)))
    return SHARED_MEMORY / f'fastrtps_port{number}'


def open_data_port(process):
    with find_data_port(process).open('r+b') as file:
        memory = mmap.mmap(file.fileno(), 0)
    readers = memory.find(AFTER_READERS, READERS * READER_SIZE) - READERS * READER_SIZE
    return Port.from_buffer(memory, readers - Port.first_reader.offset)
