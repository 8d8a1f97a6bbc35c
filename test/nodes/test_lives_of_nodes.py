"""Start and end of nodes, and their log."""

import re
import signal
import subprocess
import sys

import pytest

pytest.importorskip('rclpy')

from geometry_msgs.msg import WrenchStamped
from graph import LAST_RESORT_S, NODES, environment
from std_srvs.srv import SetBool, Trigger

from ballbot_ros.recording.messages.topics import ACCEPTED_PUSH, PLANT_IMU, RUN

pytestmark = pytest.mark.graph

DRIVERS = [name for name in NODES if name not in ('plant_sim', 'recorder')]


def lines_of(output):
    """Return the lines logged at info level, without times and hashes."""
    found = re.findall(r'^\[INFO\] \[[\d.]+\] \[[\w.]+\]: (.*)$', output, re.MULTILINE)
    return [re.sub(r'\d+ ticks, duty_sha256 \w{12}…', 'N ticks', line) for line in found]


def test_nodes_log_the_events_of_their_lives(start_node, client, tmp_path):
    path = tmp_path / 'life.mcap'
    plant = start_node('plant_sim', real_time_factor=0, require_recorder='true')
    head = plant.lines_until(' waits for ')
    drivers = [start_node(name) for name in DRIVERS]
    recorder = start_node('recorder', output=path)
    client.spin_until(lambda: PLANT_IMU.name in client.newest and client.now_ns() > 1_200_000_000)
    client.call(SetBool, 'plant_sim/pause', SetBool.Request(data=True))
    push = client.node.create_publisher(WrenchStamped, 'plant/push', 1)
    client.watch(ACCEPTED_PUSH)
    client.spin_until(
        lambda: push.get_subscription_count() and client.node.count_publishers(ACCEPTED_PUSH.name)
    )
    message = WrenchStamped()
    message.wrench.force.x = 0.5
    push.publish(message)
    client.spin_until(lambda: ACCEPTED_PUSH.name in client.newest, what='the push')
    client.call(SetBool, 'plant_sim/pause', SetBool.Request(data=False))
    client.call(Trigger, 'plant_sim/reset', Trigger.Request())
    client.spin_until(lambda: client.newest[RUN.name].frame_id.startswith('2 '))
    again = client.newest[RUN.name].stamp.sec + 1
    client.spin_until(lambda: client.now_ns() > again * 1_000_000_000)
    assert plant.interrupt() == 0
    everybody = 'gyro_driver, encoder_driver, sonar_driver, gamepad_teleop, controller, recorder'
    assert lines_of(''.join(head)) == ['started', f'run 1 waits for {everybody}']
    # Skip the later lines on missing nodes, which depend on the order in which the nodes join.
    told = [line for line in lines_of(plant.output) if ' waits for ' not in line]
    pattern = [
        r'run 1 begins at sim time 1\.000 s', r'paused',
        r'push from \d\.\d{3} s to \d\.\d{3} s: force \(0\.5, 0\) N', r'resumed',
        r'reset: run 1 ends after N ticks', r'run 2 begins at sim time \d+\.\d00 s',
        r'run 2 stopped after N ticks',
    ]  # fmt: skip
    assert len(told) == len(pattern), told
    assert all(map(re.fullmatch, pattern, told)), told
    for driver in drivers:
        assert driver.interrupt() == 0
        assert [line for line in lines_of(driver.output) if 'command' not in line] == [
            'started, waits for a run', 'takes part in run 1', 'takes part in run 2',
        ]  # fmt: skip
    assert recorder.interrupt() == 0
    assert [line for line in lines_of(recorder.output) if str(path) in line] == [
        f'records to {path}', f'finished {path}',
    ]  # fmt: skip


@pytest.mark.parametrize(
    ('imported', 'number'),
    [
        ('ballbot_ros.errors', signal.SIGTERM),
        ('numpy', signal.SIGINT),
        ('rclpy.qos', signal.SIGTERM),
    ],
)
def test_a_signal_quietly_ends_a_node_that_is_still_importing(domain, number, imported):
    node = subprocess.Popen(
        [sys.executable, '-X', 'importtime', '-m', 'ballbot_ros.nodes', 'plant_sim'],
        env=environment(domain), stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True,
    )  # fmt: skip
    try:
        assert any(line.rpartition('|')[2].strip() == imported for line in node.stderr)
        node.send_signal(number)
        rest = [line for line in node.stderr if not line.startswith('import time:')]
        assert node.wait(LAST_RESORT_S) == 0
    finally:
        node.kill()
        node.wait()
    assert [line for line in rest if 'plant_sim]: ' not in line] == []


def test_two_robots_in_two_namespaces_of_one_domain_are_refused(start_node, client):
    first = start_node('plant_sim', remap='__ns:=/a')
    client.spin_until(lambda: ('plant_sim', '/a') in client.node.get_node_names_and_namespaces())
    second = start_node('plant_sim', remap='__ns:=/b')
    assert second.finish() == 2
    (line,) = second.output.splitlines()
    assert 'another plant, player or brick_link is running in ROS domain' in line
    assert 'set ROS_DOMAIN_ID to another number' in line
    assert first.process.poll() is None
    assert first.interrupt() == 0


@pytest.mark.parametrize(
    ('arguments', 'told'), [([], 'no node given'), (['plant'], "unknown node 'plant'")]
)
def test_an_unknown_node_is_a_mistake(arguments, told):
    done = subprocess.run(
        [sys.executable, '-m', 'ballbot_ros.nodes', *arguments],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 2
    assert done.stderr.startswith(f'error: {told}; known: plant_sim, gyro_driver, ')
    assert len(done.stderr.splitlines()) == 1


@pytest.mark.parametrize('name', ['gyro_driver', 'player'])
def test_arguments_that_are_not_utf_8_are_a_mistake(name, domain):
    done = subprocess.run(
        [sys.executable, '-m', 'ballbot_ros.nodes', name, '--ros-args', '--params-file', b'\xff'],
        env=environment(domain), capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 2
    [line] = done.stderr.splitlines()
    assert line.startswith("error: 'utf-8' codec can't encode character '\\udcff' ")


SIGNALLED_WITHIN_THE_LOCK = """
import rclpy, signal
from ballbot_ros.nodes.executables import start

class Future(rclpy.Future):
    def done(self):
        with self._lock:
            signal.raise_signal(signal.SIGTERM)
        return super().done()

rclpy.Future = Future
start('gyro_driver')
"""


def test_a_signal_ends_a_node_whatever_lock_it_holds(domain):
    done = subprocess.run(
        [sys.executable, '-c', SIGNALLED_WITHIN_THE_LOCK], env=environment(domain), check=False
    )
    assert done.returncode == 0
