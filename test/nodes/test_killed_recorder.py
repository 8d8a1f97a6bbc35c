"""Whenever a recorder is killed, its file loses at most the last second."""

import random
import signal
import threading
import time

import pytest
from graph import Node, bound_s, free_domain, wait_for

from ballbot_ros.nodes.participant_ports import avoid_stale_ports
from ballbot_ros.recording.reader import RecordingReader
from ballbot_ros.recording.repair import repair

rclpy = pytest.importorskip('rclpy')

from rclpy.context import Context  # noqa: E402
from rosgraph_msgs.msg import Clock  # noqa: E402

from ballbot_ros.nodes.base import reliable_qos  # noqa: E402

pytestmark = [pytest.mark.graph, pytest.mark.slow]

BATCHES = 4
RECORDERS = 5
PERIOD_S = 0.004
MOST_S = 1.0


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
        self.now = 0.0
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
            self.now = now

    def close(self):
        self._stop.set()
        self._thread.join()
        self._node.destroy_node()
        rclpy.shutdown(context=self._context)


def test_a_killed_recorder_loses_a_second_at_most(tmp_path, monkeypatch):
    monkeypatch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    chance = random.Random(20)
    lost = []
    with free_domain() as domain:
        ticking = Ticking(domain)
        try:
            for batch in range(BATCHES):
                paths = [tmp_path / f'{batch}_{number}.mcap' for number in range(RECORDERS)]
                recorders = [Node(domain, 'recorder', output=path) for path in paths]
                try:
                    for path in paths:
                        wait_for(lambda path=path: path.exists() and path.stat().st_size > 500)
                    moments = sorted(chance.uniform(0.0, 2.0) for _ in recorders)
                    begun = time.monotonic()
                    for moment, recorder, path in zip(moments, recorders, paths, strict=True):
                        time.sleep(max(0.0, begun + moment - time.monotonic()))
                        recorder.process.send_signal(signal.SIGKILL)
                        killed_at = ticking.now
                        recorder.process.wait()
                        lost.append(killed_at - newest_s(path))
                finally:
                    for recorder in recorders:
                        recorder.kill()
        finally:
            ticking.close()
    assert len(lost) == BATCHES * RECORDERS
    assert max(lost) <= bound_s(MOST_S), sorted(lost)


def newest_s(path):
    """Repair what a recorder has left, and return the newest stamp of it [s]."""
    found = repair(path)
    assert found.output
    with RecordingReader(found.output) as reader:
        assert reader.broken is None
        stamps = [message.stamp_ns for message in reader.raw_messages(['/clock'])]
    assert stamps == sorted(stamps)
    return stamps[-1] * 1e-9
