"""Nodes find each other soon, also those that start at different times, and talk over UDP."""

import os
import socket
import subprocess
import sys
import time
from itertools import pairwise
from pathlib import Path

import pytest
from graph import bound_s, environment

from ballbot_ros.errors import BallbotError
from ballbot_ros.nodes.middleware import (
    DOMAIN,
    LOCALHOST,
    MIDDLEWARE,
    PROFILES,
    RANGE,
    STATIC_PEERS,
    prepare_middleware,
    ros_domain,
    stay_on_this_machine,
)
from ballbot_ros.parameters import GYRO

INITIAL_ANNOUNCEMENTS = 6
LAST_PEER = 31
SUBNET = 'SUBNET'

# A tool of ROS that knows nothing of this package.
LISTENER = """
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
rclpy.init()
node = rclpy.create_node('listener')
heard = rclpy.Future()
node.create_subscription(DiagnosticArray, 'diagnostics', heard.set_result, 10)
rclpy.spin_until_future_complete(node, heard, timeout_sec=60.0)
print(heard.result().status[0].name)
"""


@pytest.fixture
def bare(monkeypatch):
    """An environment in which nothing is chosen yet."""
    for name in (PROFILES, RANGE, STATIC_PEERS, MIDDLEWARE):
        monkeypatch.delenv(name, raising=False)
    return monkeypatch


@pytest.mark.graph
def test_a_node_goes_on_to_tell_of_itself_four_times_a_second(domain, start_node):
    # Where a participant with that number would listen.
    port = 7400 + 250 * domain + 10 + 2 * LAST_PEER
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as peer:
        peer.bind(('127.0.0.1', port))
        peer.settimeout(bound_s(20.0))
        start_node(GYRO)
        heard = []
        for _ in range(INITIAL_ANNOUNCEMENTS + 5):
            peer.recv(65536)
            heard.append(time.monotonic())
    gaps = [later - earlier for earlier, later in pairwise(heard[INITIAL_ANNOUNCEMENTS:])]
    assert max(gaps) < bound_s(0.5)


@pytest.mark.graph
@pytest.mark.parametrize(
    ('of_node', 'of_tool'), [(LOCALHOST, LOCALHOST), (LOCALHOST, SUBNET), (SUBNET, SUBNET)]
)
def test_nodes_share_no_memory_and_other_tools_hear_them(
    domain, start_node, monkeypatch, of_node, of_tool
):
    monkeypatch.setattr('graph.LOCALHOST', of_node)
    node = start_node(GYRO)
    others = environment(domain) | {RANGE: of_tool}
    heard = subprocess.run(
        [sys.executable, '-c', LISTENER], env=others, capture_output=True, text=True, check=True
    )
    assert heard.stdout.strip() == 'gyro_driver: loop'
    maps = Path(f'/proc/{node.process.pid}/maps').read_text()
    assert 'libfastrtps' in maps
    assert '/dev/shm/fastrtps' not in maps


def chosen():
    return Path(os.environ[PROFILES]).name, os.environ.get(RANGE)


def test_profiles_of_the_user_stay(bare):
    bare.setenv(PROFILES, 'mine.xml')
    bare.setenv(RANGE, LOCALHOST)
    prepare_middleware()
    assert chosen() == ('mine.xml', LOCALHOST)


def test_on_this_machine_the_profiles_alone_say_how_nodes_talk(bare):
    stay_on_this_machine()
    assert os.environ[RANGE] == LOCALHOST
    for _ in range(2):
        prepare_middleware()
        assert chosen() == ('fastdds_localhost.xml', 'SYSTEM_DEFAULT')


@pytest.mark.parametrize('reach', [SUBNET, 'OFF', 'SYSTEM_DEFAULT'])
def test_a_range_of_the_user_stays(bare, reach):
    bare.setenv(RANGE, reach)
    stay_on_this_machine()
    prepare_middleware()
    assert chosen() == ('fastdds.xml', reach)


@pytest.mark.parametrize(
    ('name', 'value'), [(STATIC_PEERS, '192.168.0.1'), (MIDDLEWARE, 'rmw_cyclonedds_cpp')]
)
def test_what_profiles_can_not_say_is_left_to_the_range(bare, name, value):
    bare.setenv(name, value)
    bare.setenv(RANGE, LOCALHOST)
    prepare_middleware()
    assert chosen() == ('fastdds.xml', LOCALHOST)


@pytest.mark.parametrize('text', ['abc', '-1', '1e2', '233'])
def test_what_is_no_domain_is_told_before_ros_begins(text, monkeypatch):
    monkeypatch.setenv(DOMAIN, text)
    with pytest.raises(BallbotError, match=rf'^{DOMAIN}={text}: set a number within 0 … 232$'):
        prepare_middleware()


@pytest.mark.parametrize(('text', 'domain'), [('', 0), ('7', 7), ('232', 232)])
def test_the_domain_is_that_of_the_environment(text, domain, monkeypatch):
    monkeypatch.setenv(DOMAIN, text)
    assert ros_domain() == domain
