import contextlib

import pytest

from ballbot_ros.recording.messages.topics import PLANT_IMU, RUN


@pytest.fixture
def client(domain):
    """Yield a test node that watches the truth and the runs."""
    pytest.importorskip('rclpy')
    from ros_client import Client

    with contextlib.closing(Client(domain)) as client:
        client.watch(PLANT_IMU)
        client.watch(RUN)
        yield client
