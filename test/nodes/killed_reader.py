"""Shows that a publisher deadlocks if its reader was killed while taking a message.

Run this with private shared memory. It kills a reader, stops the publisher where it adds a message
to the reader's port, and puts the port into the state after a reader was killed while taking a
message and was found dead. Prints 'waits' when the publisher waits for its own lock, and 'goes on'
when it publishes again after the readers were marked.
"""

import os
import subprocess
import sys
import time
from pathlib import Path

import rclpy
from ports import LIBC, open_data_port
from std_msgs.msg import Empty

from ballbot_ros.nodes.shared_memory import mark_dead_readers

LOCKED, CONTENDED = 1, 2
IS_OK = 1
TAKES_A_MESSAGE = 5
FUTEX = '202 '
NEVER_MS = 2**62


def publish():
    rclpy.init()
    publisher = rclpy.create_node('publisher').create_publisher(Empty, 'data', 1)
    while True:
        publisher.publish(Empty())
        print(flush=True)
        # Publish slowly: a port holds 512 messages, and once it is full, the publisher adds none
        # and does not wait.
        time.sleep(0.1)


def read():
    rclpy.init()
    node = rclpy.create_node('reader')
    node.create_subscription(Empty, 'data', lambda message: print(flush=True), 1)
    rclpy.spin(node)


def start(role):
    return subprocess.Popen([sys.executable, __file__, role], stdout=subprocess.PIPE, bufsize=0)


def wait_for(condition):
    while not condition():
        time.sleep(0.001)


def is_blocked(process, thread):
    """Return whether a thread waits for a lock."""
    return Path(f'/proc/{process}/task/{thread}/syscall').read_text().startswith(FUTEX)


def kill(reader):
    """Kill the reader; return its port, locked."""
    reader.stdout.readline()
    port = open_data_port(reader.pid)
    # Prevent the check of Fast DDS, which after one second would find the reader dead and remove
    # the port.
    port.readers_checked_ms = NEVER_MS
    LIBC.pthread_mutex_lock(port.mutex)  # so that the reader does not die holding the mutex
    reader.kill()
    reader.wait()
    port.lock = LOCKED  # without waiters: the killed reader may have been one
    return port


def hold_up(publisher, port):
    """Set the state that a killed reader leaves, while the publisher waits to add a message."""
    wait_for(lambda: port.lock == CONTENDED)
    port.flags &= ~IS_OK
    port.first_reader = TAKES_A_MESSAGE
    LIBC.pthread_mutex_unlock(port.mutex)
    wait_for(lambda: port.owner and is_blocked(publisher.pid, port.owner))


def skip_what_was_printed(process):
    os.set_blocking(process.stdout.fileno(), False)
    while process.stdout.read(4096):
        pass
    os.set_blocking(process.stdout.fileno(), True)


def main():
    publisher, reader = start('publish'), start('read')
    try:
        port = kill(reader)
        hold_up(publisher, port)
        print('waits')
        skip_what_was_printed(publisher)
        mark_dead_readers()
        publisher.stdout.readline()
        print('goes on')
    finally:
        publisher.kill()
        reader.kill()


if __name__ == '__main__':
    {'publish': publish, 'read': read}.get(''.join(sys.argv[1:]), main)()
