"""A recorder killed at any moment loses at most the last second."""

import random
import subprocess
import sys
import time

import pytest
from graph import environment, wait_for

from ballbot_ros.parameters import RecorderParameters
from ballbot_ros.recording.reader import RecordingReader
from ballbot_ros.recording.repair import repair

rclpy = pytest.importorskip('rclpy')

from ballbot_ros.nodes.recorder import FLUSH_PERIOD_S, Recorder  # noqa: E402

pytestmark = pytest.mark.graph

RECORDERS = 6

# A /clock that shows the wall clock, with the period of the graph.
TICKING = """
import time

import rclpy
from rosgraph_msgs.msg import Clock

from ballbot_ros.nodes.middleware import prepare_middleware
from ballbot_ros.nodes.endpoints import reliable_qos

prepare_middleware()
rclpy.init()
node = rclpy.create_node('ticking')
publisher = node.create_publisher(Clock, '/clock', reliable_qos(128, latched=True))
begun, message = time.monotonic(), Clock()
while True:
    time.sleep(0.004)
    now = 1.0 + time.monotonic() - begun
    message.clock.sec, message.clock.nanosec = divmod(int(now * 1e9), 10**9)
    publisher.publish(message)
"""


@pytest.fixture
def ticking(domain):
    with subprocess.Popen([sys.executable, '-c', TICKING], env=environment(domain)) as process:
        yield
        process.kill()


@pytest.mark.usefixtures('ticking')
def test_a_recorder_killed_at_any_moment_leaves_its_written_messages(start_node, tmp_path):
    chance = random.Random(20)
    paths = [tmp_path / f'{number}.mcap' for number in range(RECORDERS)]
    recorders = [start_node('recorder', output=path) for path in paths]
    for path in paths:
        await_growth(path)
    had = [newest_s(path, tmp_path) for path in paths]
    for path in paths:
        await_growth(path)
    # Within one flush interval.
    for recorder in recorders:
        time.sleep(chance.uniform(0.0, FLUSH_PERIOD_S / RECORDERS))
        recorder.kill()
    for path, before in zip(paths, had, strict=True):
        assert newest_s(path, tmp_path) > before


def await_growth(path):
    """Wait until messages have been written."""
    before = path.stat().st_size if path.exists() else 0
    wait_for(lambda: path.exists() and path.stat().st_size > max(before, 500), what='a write')


def test_a_recorder_writes_twice_a_second(domain, monkeypatch, tmp_path):
    """This is why a killed recorder loses no more than the last second."""
    monkeypatch.setenv('ROS_DOMAIN_ID', str(domain))
    rclpy.init()
    try:
        recorder = Recorder(RecorderParameters(output=str(tmp_path / 'run.mcap')))
        (period_ns,) = (
            timer.timer_period_ns for timer in recorder.timers if timer.callback == recorder._flush
        )
        recorder.close()
        recorder.destroy_node()
    finally:
        rclpy.try_shutdown()
    assert period_ns <= 500_000_000


def newest_s(path, folder):
    """Repair a copy of a recorder's file, and return its newest stamp [s]."""
    cut, repaired = folder / 'cut.mcap', folder / 'repaired.mcap'
    cut.write_bytes(path.read_bytes())
    repaired.unlink(missing_ok=True)
    assert repair(cut, repaired).output
    with RecordingReader(repaired) as reader:
        assert reader.corruption is None
        stamps = [message.stamp_ns for message in reader.raw_messages(['/clock'])]
    assert stamps == sorted(stamps)
    return stamps[-1] * 1e-9
