"""Runs that leave a role to a program of the user: `ballbot run --external`."""

import json

import pytest

rclpy = pytest.importorskip('rclpy')

from graph import call  # noqa: E402
from ros_client import header  # noqa: E402
from sensor_msgs.msg import Imu  # noqa: E402
from std_msgs.msg import Header  # noqa: E402

from ballbot_ros.lockstep.participants import Announcement, Participant  # noqa: E402
from ballbot_ros.nodes.endpoints import reliable_qos  # noqa: E402
from ballbot_ros.parameters import GYRO, NODES, RECORDER  # noqa: E402
from ballbot_ros.parameters.timing import TICK_NS  # noqa: E402
from ballbot_ros.recording.messages.conversions import time_ns  # noqa: E402
from ballbot_ros.recording.messages.run_reports import encode_announcement  # noqa: E402
from ballbot_ros.recording.messages.topics import (  # noqa: E402
    GYRO_IMU,
    HISTORY,
    PARTICIPANTS,
    PLANT_IMU,
    ROLL_CALL,
)

pytestmark = pytest.mark.graph

SHORT = ('--json', '--set', 'plant_sim.duration=1.2')
START_S = 8
"""A limit for the start of nodes that our own ones never reach: they need a second of processor
time, three on a slow machine."""


def test_the_node_of_the_user_takes_the_place(start_run, start_node, tmp_path):
    run = start_run('stationary', *SHORT, '--external', GYRO, '--output', tmp_path)
    node = start_node(GYRO)
    assert run.finish() in (0, 1), run.stderr  # such a short run may miss the expectations
    assert run.result['external'] == [GYRO]
    without_nodes = call('run', 'stationary', *SHORT, '--processes=none', '--no-record')
    assert run.result['duty_sha256'] == json.loads(without_nodes.stdout)['duty_sha256']
    assert run.result['recording'] == str(tmp_path / 'stationary.mcap')
    (process,) = (row['process'] for row in run.result['participants'] if row['role'] == GYRO)
    assert process == node.process.pid
    assert run.stderr.startswith(f'waiting for {GYRO}: start within 30 s, with ROS_DOMAIN_ID=')
    assert node.process.poll() is None  # it waits for the next run


def test_an_external_recorder_writes_the_file(start_run, start_node, tmp_path):
    run = start_run('stationary', *SHORT, '--processes=one', '--external', RECORDER,
                    '--output', tmp_path / 'run')  # fmt: skip
    recorder = start_node(RECORDER, output=tmp_path / 'mine.mcap')
    assert run.finish() in (0, 1), run.stderr
    assert run.result['recording'] is None
    assert {row['role'] for row in run.result['participants']} == set(NODES)
    recorder.interrupt()
    assert (tmp_path / 'mine.mcap').stat().st_size > 100_000
    assert [path.name for path in (tmp_path / 'run').iterdir()] == ['stationary.png']


class WrongGyro:
    """A gyro whose answers have the stamp of the tick before."""

    def __init__(self, node):
        self._answered_ns = 0
        self._participant = Participant(
            GYRO, node.get_fully_qualified_name(), 'elsewhere', 1, 'mine', 'my own', '00',
            topics=(GYRO_IMU.name,),
        )  # fmt: skip
        stream, latched = reliable_qos(HISTORY, latched=False), reliable_qos(1, latched=True)
        self._samples = node.create_publisher(Imu, GYRO_IMU.name, stream)
        self._announcements = node.create_publisher(
            PARTICIPANTS.message_class, PARTICIPANTS.name, latched
        )
        node.create_subscription(Header, ROLL_CALL.name, self._on_call, latched)
        node.create_subscription(Imu, PLANT_IMU.name, self._on_truth, stream)

    def _on_call(self, call):
        announcement = Announcement(self._participant, call.frame_id, self._answered_ns)
        self._announcements.publish(encode_announcement(announcement))

    def _on_truth(self, truth):
        self._answered_ns = time_ns(truth.header.stamp)
        sample = Imu(angular_velocity=truth.angular_velocity)
        sample.header = header(self._answered_ns - TICK_NS)
        self._samples.publish(sample)


def test_a_wrong_stamp_is_named_with_its_sender(start_run, client):
    gyro = WrongGyro(client.node)
    run = start_run('stationary', *SHORT, '--processes=one', '--no-record', '--external', GYRO,
                    '--set', f'plant_sim.startup_timeout={START_S}')  # fmt: skip
    client.spin_until(lambda: run.process.poll() is not None, what='the end of the run')
    assert gyro
    assert run.finish() == 1
    assert run.result['reason'] == (
        f"{GYRO} silent for {START_S} s at sim time 1.000 s: its newest 'gyro' is stamped 0.996 s"
    )
    assert run.result['ticks'] == 0
