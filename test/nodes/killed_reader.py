"""A publisher whose reader was killed while it took a message waits for a lock that it holds.

Run this where no other process sees its shared memory. It kills a reader, holds up the publisher
where that adds a message to the reader's port, and gives the port the state in which a reader
leaves it that is killed just then, and that Fast DDS has found dead. Prints 'waits', and 'goes on'
once the publisher publishes again because of a node that lives.
"""

import ctypes
import mmap
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import rclpy
from std_msgs.msg import Empty

from ballbot_ros.nodes.shared_memory import (
    AFTER_READERS,
    READER_SIZE,
    READERS,
    SHARED_MEMORY,
    find_stale_ports,
)

CONTENDED = 2
IS_OK = 1
TAKES_A_MESSAGE = 5
FUTEX = '202 '


class Port(ctypes.Structure):
    """The beginning of a port of Fast DDS 2.14 on x86-64, up to the state of its first reader."""

    _fields_ = [
        ('readers_checked_ms', ctypes.c_int64),
        ('_', ctypes.c_uint32 * 9),
        ('flags', ctypes.c_uint32),
        ('_condition', ctypes.c_char * 20544),
        ('lock', ctypes.c_int32),
        ('_count', ctypes.c_int32),
        ('owner', ctypes.c_int32),
        ('_mutex', ctypes.c_int32 * 7),
        ('first_reader', ctypes.c_uint8),
    ]


def open_port(number):
    with (SHARED_MEMORY / f'fastrtps_port{number}').open('r+b') as file:
        memory = mmap.mmap(file.fileno(), 0)
    readers = memory.find(AFTER_READERS, READERS * READER_SIZE) - READERS * READER_SIZE
    return Port.from_buffer(memory, readers - Port.first_reader.offset)


def publish():
    rclpy.init()
    publisher = rclpy.create_node('publisher').create_publisher(Empty, 'data', 1)
    while True:
        publisher.publish(Empty())
        print(flush=True)
        time.sleep(0.001)


def read():
    rclpy.init()
    node = rclpy.create_node('reader')
    node.create_subscription(Empty, 'data', lambda message: print(flush=True), 1)
    rclpy.spin(node)


def start(role):
    return subprocess.Popen([sys.executable, __file__, role], stdout=subprocess.PIPE)


def start_node():
    command = [sys.executable, '-m', 'ballbot_ros.nodes', 'gyro_driver']
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT)


def wait_for(condition):
    while not condition():
        time.sleep(0.001)


def is_blocked(process, thread):
    """Whether a thread waits for a lock."""
    return Path(f'/proc/{process}/task/{thread}/syscall').read_text().startswith(FUTEX)


def main():
    with start('publish') as publisher, start('read') as reader, start_node() as node:
        try:
            node.stdout.readline()
            node.send_signal(signal.SIGSTOP)
            reader.stdout.readline()
            reader.kill()
            reader.wait()
            port = open_port(max(find_stale_ports()))
            # Otherwise Fast DDS, too, takes the lock, to look whether the reader lives.
            port.readers_checked_ms = 2 * port.readers_checked_ms
            mutex = ctypes.byref(port, Port.lock.offset)
            libc = ctypes.CDLL(None)
            libc.pthread_mutex_lock(mutex)
            wait_for(lambda: port.lock == CONTENDED)
            port.flags &= ~IS_OK
            port.first_reader = TAKES_A_MESSAGE
            libc.pthread_mutex_unlock(mutex)
            wait_for(lambda: port.owner and is_blocked(publisher.pid, port.owner))
            print('waits')
            os.set_blocking(publisher.stdout.fileno(), False)
            publisher.stdout.read()
            os.set_blocking(publisher.stdout.fileno(), True)
            node.send_signal(signal.SIGCONT)
            publisher.stdout.readline()
            print('goes on')
        finally:
            publisher.kill()
            reader.kill()
            node.kill()


if __name__ == '__main__':
    {'publish': publish, 'read': read}.get(''.join(sys.argv[1:]), main)()
