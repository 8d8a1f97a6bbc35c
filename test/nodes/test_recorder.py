"""Messages of strangers do not end the recorder."""

import pytest
from graph import wait_for

rclpy = pytest.importorskip('rclpy')

from ballbot_ros.messages.conversions import encode_header  # noqa: E402
from ballbot_ros.messages.topics import RUN  # noqa: E402
from ballbot_ros.nodes.recorder import Recorder  # noqa: E402
from ballbot_ros.parameters import RecorderParameters  # noqa: E402

pytestmark = pytest.mark.graph

ANNOUNCED = encode_header(1_000_000_000, '1 abc')
MALFORMED = (ANNOUNCED[:7], ANNOUNCED.replace(b'abc', b'\xff\xff\xff'))


def test_a_malformed_announcement_of_a_run_is_ignored(domain, monkeypatch, tmp_path):
    monkeypatch.setenv('ROS_DOMAIN_ID', str(domain))
    monkeypatch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    rclpy.init()
    try:
        recorder = Recorder(RecorderParameters(output=str(tmp_path / 'run.mcap')))
        publisher = recorder.create_publisher(RUN.message_class, RUN.name, 10)

        def has_begun():
            for data in (*MALFORMED, ANNOUNCED):
                publisher.publish(data)
            recorder._poll()
            return recorder._run == '1 abc'

        wait_for(has_begun, what='the run')
        recorder.close()
        recorder.destroy_node()
    finally:
        rclpy.try_shutdown()
