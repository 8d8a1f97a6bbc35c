"""Whenever a recorder is killed, its file loses at most the last second."""

import contextlib
import random
import threading
import time

import pytest
from graph import wait_for

from ballbot_ros.nodes.participant_ports import avoid_stale_ports
from ballbot_ros.recording.reader import RecordingReader
from ballbot_ros.recording.repair import repair

rclpy = pytest.importorskip('rclpy')

from rclpy.context import Context  # noqa: E402
from rosgraph_msgs.msg import Clock  # noqa: E402

from ballbot_ros.nodes.base import reliable_qos  # noqa: E402
from ballbot_ros.nodes.recorder import FLUSH_S, Recorder  # noqa: E402

pytestmark = pytest.mark.graph

RECORDERS = 6
PERIOD_S = 0.004


class Ticking:
    """A /clock that shows the wall clock, in the graph's own period."""

    def __init__(self, domain):
        self._context = Context()
        rclpy.init(context=self._context, domain_id=domain)
        with avoid_stale_ports(domain):
            self._node = rclpy.create_node('ticking', context=self._context)
        self._publisher = self._node.create_publisher(
            Clock, '/clock', reliable_qos(128, latched=True)
        )
        self._begun = time.monotonic()
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._tick)
        self._thread.start()

    def _tick(self):
        message = Clock()
        while not self._stop.wait(PERIOD_S):
            now = 1.0 + time.monotonic() - self._begun
            message.clock.sec, message.clock.nanosec = divmod(int(now * 1e9), 10**9)
            self._publisher.publish(message)

    def close(self):
        self._stop.set()
        self._thread.join()
        self._node.destroy_node()
        rclpy.shutdown(context=self._context)


@pytest.fixture
def ticking(domain, monkeypatch):
    monkeypatch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    with contextlib.closing(Ticking(domain)):
        yield


@pytest.mark.usefixtures('ticking')
def test_a_recorder_that_is_killed_at_any_moment_leaves_what_it_wrote(start_node, tmp_path):
    chance = random.Random(20)
    paths = [tmp_path / f'{number}.mcap' for number in range(RECORDERS)]
    recorders = [start_node('recorder', output=path) for path in paths]
    for recorder, path in zip(recorders, paths, strict=True):
        await_growth(path)
        had = newest_s(path, tmp_path)
        await_growth(path)
        time.sleep(chance.uniform(0.0, FLUSH_S))
        recorder.kill()
        assert newest_s(path, tmp_path) > had


def await_growth(path):
    """Wait until messages have been written."""
    before = path.stat().st_size if path.exists() else 0
    wait_for(lambda: path.exists() and path.stat().st_size > max(before, 500), what='a write')


def test_a_recorder_writes_twice_a_second(domain, monkeypatch, tmp_path):
    """So a killed one loses no more than the last second."""
    monkeypatch.setenv('ROS_DOMAIN_ID', str(domain))
    monkeypatch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    rclpy.init()
    try:
        recorder = Recorder({'output': str(tmp_path / 'run.mcap')})
        (period_ns,) = (
            timer.timer_period_ns for timer in recorder.timers if timer.callback == recorder._flush
        )
        recorder.close()
        recorder.destroy_node()
    finally:
        rclpy.try_shutdown()
    assert period_ns <= 500_000_000


def newest_s(path, folder):
    """Repair a copy of what a recorder has written, and return the newest stamp of it [s]."""
    cut, repaired = folder / 'cut.mcap', folder / 'repaired.mcap'
    cut.write_bytes(path.read_bytes())
    repaired.unlink(missing_ok=True)
    assert repair(cut, repaired).output
    with RecordingReader(repaired) as reader:
        assert reader.broken is None
        stamps = [message.stamp_ns for message in reader.raw_messages(['/clock'])]
    assert stamps == sorted(stamps)
    return stamps[-1] * 1e-9
