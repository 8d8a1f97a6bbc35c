"""A node whose port other processes have removed."""

import contextlib
import platform
import re
from pathlib import Path

import pytest

pytest.importorskip('rclpy')

from ros_client import Client, header

from ballbot_ros.messages.topics import PARTICIPANTS, ROLL_CALL
from ballbot_ros.nodes.shared_memory import SHARED_MEMORY
from ballbot_ros.parameters import GYRO
from ballbot_ros.simulation.timing import FIRST_TICK_NS

LOCK = re.compile(r'/dev/shm/fastrtps_port(\d+)_el')

pytestmark = [
    pytest.mark.graph,
    pytest.mark.skipif(
        platform.machine() != 'x86_64', reason="the port's layout is that of x86-64"
    ),
]


def lock_of_data_port(process):
    """The ports for discovery, from 7000 on, are common to all domains."""
    links = [str(link.readlink()) for link in Path(f'/proc/{process}/fd').iterdir()]
    numbers = [int(match[1]) for link in links if (match := LOCK.fullmatch(link))]
    return SHARED_MEMORY / f'fastrtps_port{max(numbers)}_el'


@pytest.mark.parametrize('removed', [('', '_el'), ('',)], ids=['with its lock', 'only'])
def test_a_node_hears_newcomers_after_others_have_removed_its_port(domain, start_node, removed):
    node = start_node(GYRO)
    node.process.stdout.readline()
    lock = lock_of_data_port(node.process.pid)
    for suffix in removed:
        lock.with_name(lock.name.removesuffix('_el') + suffix).unlink()
    with contextlib.closing(Client(domain)) as client:
        client.watch(PARTICIPANTS, depth=10)
        client.publish(ROLL_CALL, lambda: header(FIRST_TICK_NS, '1 a'))
        client.spin_until(lambda: PARTICIPANTS.name in client.newest, what='an announcement')
    assert client.newest[PARTICIPANTS.name].name == f'/{GYRO}'
    assert lock_of_data_port(node.process.pid) == lock
