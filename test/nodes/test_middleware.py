"""Nodes discover each other fast, even if they start at different times."""

import contextlib
import os
import pwd
import signal
import socket
import struct
import subprocess
import sys
from collections import defaultdict
from hashlib import sha256
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace

import pytest
from graph import (
    BALLBOT,
    LAST_RESORT_S,
    children,
    environment,
    occupied,
    private_shared_memory,
    wait_for,
)

from ballbot_ros.errors import BallbotError
from ballbot_ros.files import share_directory
from ballbot_ros.nodes.endpoints import reliable_qos
from ballbot_ros.nodes.middleware import (
    DISCOVERY_RANGE,
    DOMAIN,
    LOCALHOST_ONLY,
    PROFILES,
    RMW,
    STATIC_PEERS,
    is_local,
    prepare_log_folder,
    prepare_middleware,
    require_discovery,
    require_middleware,
    ros_domain,
)
from ballbot_ros.parameters import GYRO, NODES, RECORDER
from ballbot_ros.recording.messages.topics import DIAGNOSTICS, JOINT_STATES, LCD, MOTOR_DUTY

CONFIG = share_directory() / 'config'
LAST_PEER = 31
SECONDS = 4
MESSAGES = 500
PARTICIPANT = slice(8, 20)  # of an RTPS message
SO_TIMESTAMPNS = 35  # the system notes when each message arrives


@pytest.mark.graph
def test_a_node_announces_itself_four_times_a_second(domain, run_node, monkeypatch):
    """A busy machine may only delay announcements: the two closest ones show the period."""
    pytest.importorskip('rclpy')
    from ros_client import Client

    # The port on which a participant with that number would listen.
    port = 7400 + 250 * domain + 10 + 2 * LAST_PEER
    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as peer,
        contextlib.closing(Client(domain)) as client,
    ):
        client.watch(DIAGNOSTICS, depth=100)
        monkeypatch.delenv(PROFILES)
        monkeypatch.setenv(DISCOVERY_RANGE, 'LOCALHOST')
        run_node(GYRO)
        client.spin_until(lambda: DIAGNOSTICS.name in client.seen)
        peer.setsockopt(socket.SOL_SOCKET, SO_TIMESTAMPNS, 1)
        peer.bind(('127.0.0.1', port))
        client.seen.clear()
        client.spin_until(lambda: len(client.seen.get(DIAGNOSTICS.name, ())) == SECONDS)
        peer.setblocking(False)
        heard = defaultdict(list)
        with contextlib.suppress(BlockingIOError):
            while True:
                message, [(_, _, time)], *_ = peer.recvmsg(65536, 64)
                seconds, nanoseconds = struct.unpack('=qq', time)
                heard[message[PARTICIPANT]].append(seconds + 1e-9 * nanoseconds)
    assert len(heard) == 2  # the node and the client
    for times_s in heard.values():
        spans_s = (after - before for before, after in pairwise(times_s))
        assert min(spans_s, default=SECONDS) < 0.5


@pytest.mark.graph
def test_a_message_wakes_no_thread_of_its_writer(domain, run_node):
    """The timers of the writer go on; each message would restart one that has run out."""
    pytest.importorskip('rclpy')
    from ros_client import Client

    with contextlib.closing(Client(domain)) as client:
        run_node(RECORDER)
        publisher = client.node.create_publisher(
            JOINT_STATES.message_class, JOINT_STATES.name, reliable_qos(MESSAGES, latched=False)
        )
        client.spin_until(lambda: publisher.get_subscription_count() > 0)
        publisher.publish(JOINT_STATES.message_class())
        before = switches_of('dds.ev')
        for _ in range(MESSAGES):
            publisher.publish(JOINT_STATES.message_class())
        assert switches_of('dds.ev') - before < MESSAGES / 10


@pytest.mark.graph
def test_killed_nodes_leave_nothing_in_shared_memory(domain):
    script = '"$@"; for each in /dev/shm/fast*; do echo "left: $each"; done'
    command = [*private_shared_memory(), 'sh', '-c', script, 'sh', *BALLBOT, 'run', 'stationary']
    with subprocess.Popen(
        [*command, '--no-record', '--set', 'plant_sim.duration=300'],
        stdout=subprocess.PIPE,
        text=True,
        env=environment(domain),
    ) as run:
        nodes = wait_for(lambda: len(found := children(run.pid)) == len(NODES) - 1 and found)
        for pid in nodes.values():
            os.kill(pid, signal.SIGKILL)
        output, _ = run.communicate(timeout=LAST_RESORT_S)
    assert 'failed: ' in output
    assert 'left: /dev/shm/fast*' in output.splitlines()  # an unmatched pattern stays


READER = """
import hashlib

import rclpy
from std_msgs.msg import String

from ballbot_ros.nodes.middleware import prepare_middleware
from ballbot_ros.nodes.endpoints import reliable_qos


def take(message):
    print(hashlib.sha256(message.data.encode()).hexdigest(), flush=True)


prepare_middleware()
rclpy.init()
node = rclpy.create_node('reader')
node.create_subscription(String, 'long', take, reliable_qos(1, latched=True))
rclpy.spin(node)
"""


@pytest.mark.graph
def test_messages_of_a_megabyte_arrive(domain):
    pytest.importorskip('rclpy')
    from ros_client import Client

    with (
        contextlib.closing(Client(domain)) as client,
        subprocess.Popen(
            [sys.executable, '-c', READER],
            env=environment(domain),
            stdout=subprocess.PIPE,
            text=True,
        ) as reader,
    ):
        kind = LCD.message_class
        publisher = client.node.create_publisher(kind, 'long', reliable_qos(1, latched=True))
        for letter in 'abc':
            text = letter * (1 << 20)
            publisher.publish(kind(data=text))
            assert reader.stdout.readline().strip() == sha256(text.encode()).hexdigest()
        reader.kill()


def switches_of(name):
    """Return the context switches of the threads of this process whose names begin so."""
    threads = list(Path('/proc/self/task').iterdir())
    return sum(
        int(line.split()[1])
        for thread in threads
        if (thread / 'comm').read_text().startswith(name)
        for line in (thread / 'status').read_text().splitlines()
        if 'ctxt_switches' in line
    )


def test_profiles_follow_the_range_and_the_user(monkeypatch):
    """Each row is the environment, and then the range, the profiles and the reach."""
    local, network = (str(CONFIG / name) for name in ('fastdds_local.xml', 'fastdds.xml'))
    here, peers = {DISCOVERY_RANGE: 'LOCALHOST'}, {STATIC_PEERS: '192.0.2.1'}
    set_before = {DISCOVERY_RANGE: 'SYSTEM_DEFAULT', PROFILES: local}
    for variables, expected in (
        (here, ('SYSTEM_DEFAULT', local, True)),
        (set_before, ('SYSTEM_DEFAULT', local, True)),
        (set_before | here, ('SYSTEM_DEFAULT', local, True)),
        ({LOCALHOST_ONLY: '1'} | peers, ('SYSTEM_DEFAULT', local, True)),
        (here | {RMW: 'rmw_fastrtps_cpp'}, ('SYSTEM_DEFAULT', local, True)),
        (here | {RMW: 'rmw_cyclonedds_cpp'}, ('LOCALHOST', None, True)),
        (here | {PROFILES: 'mine.xml'}, ('LOCALHOST', 'mine.xml', True)),
        (here | peers, ('LOCALHOST', None, False)),
        (set_before | here | peers, ('LOCALHOST', None, False)),
        ({}, (None, network, False)),
        ({DISCOVERY_RANGE: 'SUBNET'} | peers, ('SUBNET', network, False)),
        (set_before | {DISCOVERY_RANGE: 'SUBNET'}, ('SUBNET', network, False)),
        ({DISCOVERY_RANGE: 'SYSTEM_DEFAULT'}, ('SYSTEM_DEFAULT', network, False)),
    ):
        for name in (DISCOVERY_RANGE, LOCALHOST_ONLY, STATIC_PEERS, PROFILES, RMW):
            monkeypatch.delenv(name, raising=False)
        for name, value in variables.items():
            monkeypatch.setenv(name, value)
        before = is_local()
        prepare_middleware()
        found = os.environ.get(DISCOVERY_RANGE), os.environ.get(PROFILES), is_local()
        assert (found, before) == (expected, expected[-1]), variables
        assert LOCALHOST_ONLY not in os.environ


@pytest.mark.graph
def test_a_missing_loopback_interface_is_reported(domain):
    command = ['unshare', '--net', *BALLBOT, 'run', 'stationary', '--no-record']
    done = subprocess.run(
        command, capture_output=True, text=True, env=environment(domain), check=False
    )
    if done.stderr.startswith('unshare: '):
        pytest.skip('no network namespace can be made here')
    assert done.stderr.startswith('error: 127.0.0.1: Network is unreachable: bring the loopback ')
    assert done.returncode == 2


@pytest.mark.graph
@pytest.mark.parametrize(('processes', 'present'), [('separate', 27), ('one', 32)])
def test_a_domain_without_room_for_all_nodes_is_reported(domain, processes, present):
    first = 7400 + 250 * domain + 10
    command = [*BALLBOT, 'run', 'stationary', '--no-record', '--processes', processes]
    with contextlib.ExitStack() as ports:
        for port in range(first, first + 2 * present):
            ports.enter_context(occupied(port))
        done = subprocess.run(
            command, capture_output=True, text=True, env=environment(domain), check=False
        )
    assert done.stderr.splitlines()[-1] == (
        f'error: ROS domain {domain} has {present} participants on this machine, and only 32 find '
        'each other: end some of them, or set another ROS_DOMAIN_ID'
    )
    assert done.returncode == 2


@pytest.mark.parametrize('text', ['abc', '-1', '1e2', '233', '٣', '010', '1' * 5000])
def test_an_invalid_domain_is_reported_before_ros_starts(text, monkeypatch):
    monkeypatch.setenv(DOMAIN, text)
    with pytest.raises(BallbotError, match=rf'^{DOMAIN}={text}: set a number within 0 … 232$'):
        prepare_middleware()


@pytest.mark.parametrize(('text', 'domain'), [('', 0), ('7', 7), ('232', 232)])
def test_the_domain_is_that_of_the_environment(text, domain, monkeypatch):
    monkeypatch.setenv(DOMAIN, text)
    assert ros_domain() == domain


def test_a_missing_middleware_is_reported_before_it_ends_the_process(monkeypatch):
    pytest.importorskip('rclpy')
    monkeypatch.setenv('RMW_IMPLEMENTATION', 'rmw_nosuch_cpp')
    with pytest.raises(BallbotError, match=r'^RMW_IMPLEMENTATION=rmw_nosuch_cpp does not load: '):
        require_middleware()


def test_another_middleware_may_be_chosen(monkeypatch):
    monkeypatch.setenv('RMW_IMPLEMENTATION', 'rmw_other_cpp')
    loaded = SimpleNamespace(returncode=0)
    monkeypatch.setattr(subprocess, 'run', lambda *_, **__: loaded)
    require_middleware()


def test_the_folder_of_logs_needs_no_variable(monkeypatch, tmp_path):
    home = Path(pwd.getpwuid(os.getuid()).pw_dir)
    for name in ('HOME', 'ROS_HOME', 'ROS_LOG_DIR'):
        monkeypatch.delenv(name, raising=False)
    prepare_log_folder()
    assert os.environ['ROS_LOG_DIR'] == str(home / '.ros/log')
    monkeypatch.delenv('ROS_LOG_DIR')
    monkeypatch.setenv('ROS_HOME', str(tmp_path))
    prepare_log_folder()
    assert os.environ['ROS_LOG_DIR'] == str(tmp_path / 'log')


def test_a_folder_of_logs_that_is_not_writable_is_named(monkeypatch, tmp_path):
    (tmp_path / 'file').touch()
    monkeypatch.setenv('ROS_LOG_DIR', str(tmp_path / 'file/log'))
    with pytest.raises(BallbotError, match=r'/file/log: Not a directory; set ROS_LOG_DIR to a '):
        prepare_log_folder()


@pytest.mark.parametrize('name', ['', 'rmw_fastrtps_cpp'])
def test_the_default_middleware_is_assumed_to_be_installed(monkeypatch, name):
    monkeypatch.setenv('RMW_IMPLEMENTATION', name)
    monkeypatch.setattr(subprocess, 'run', lambda *arguments: pytest.fail('asked'))
    require_middleware()


def test_without_discovery_no_node_is_started(monkeypatch):
    monkeypatch.setenv(DISCOVERY_RANGE, 'OFF')
    with pytest.raises(
        BallbotError, match=f'^{DISCOVERY_RANGE}=OFF: nodes cannot discover each other'
    ):
        require_discovery()


WRITER = """
import rclpy
from ballbot_ros.recording.messages.topics import MOTOR_DUTY
from ballbot_ros.nodes.middleware import prepare_middleware
from ballbot_ros.nodes.endpoints import TopicPublisher, flush

prepare_middleware()
rclpy.init()
output = TopicPublisher(rclpy.create_node('writer'), MOTOR_DUTY)
while not output.has_subscribers:
    pass
for _ in range(3):
    output.publish(MOTOR_DUTY.message_class())
    print(flush(output.publishers))
"""


@pytest.mark.graph
def test_a_reader_acknowledges_the_last_message_soon(domain, client):
    """By default a writer asks for it only every 3 s, longer than a flush waits."""
    client.watch(MOTOR_DUTY)
    env = environment(domain)
    env.pop(PROFILES, None)
    answers = subprocess.check_output([sys.executable, '-c', WRITER], env=env, text=True)
    assert answers.split() == ['True'] * 3
