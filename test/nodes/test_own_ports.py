"""A node whose port other processes have removed."""

import contextlib

import pytest

pytest.importorskip('rclpy')

from ports import find_data_port, needs_layout_of_ports
from ros_client import Client, header

from ballbot_ros.messages.topics import PARTICIPANTS, ROLL_CALL
from ballbot_ros.parameters import GYRO
from ballbot_ros.timing import FIRST_TICK_NS

pytestmark = [pytest.mark.graph, needs_layout_of_ports]


@pytest.mark.parametrize('removed', [('', '_el'), ('',)], ids=['with its lock', 'only'])
def test_a_node_hears_new_nodes_after_others_have_removed_its_port(domain, start_node, removed):
    node = start_node(GYRO)
    node.lines_until('started')
    port = find_data_port(node.process.pid)
    for suffix in removed:
        port.with_name(port.name + suffix).unlink()
    with contextlib.closing(Client(domain)) as client:
        client.watch(PARTICIPANTS, depth=10)
        client.publish(ROLL_CALL, lambda: header(FIRST_TICK_NS, '1 a'))
        client.spin_until(lambda: PARTICIPANTS.name in client.newest, what='an announcement')
    assert client.newest[PARTICIPANTS.name].name == f'/{GYRO}'
    assert find_data_port(node.process.pid) == port
