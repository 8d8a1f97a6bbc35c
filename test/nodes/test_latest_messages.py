"""A node that shows the graph handles messages in any order."""

import contextlib

import pytest

pytest.importorskip('rclpy')

from ros_client import Client

from ballbot_ros.messages.topics import PLANT_IMU, PLANT_ODOM, RUN
from ballbot_ros.nodes.latest_messages import LatestMessages
from ballbot_ros.nodes.topic_publisher import reliable_qos

pytestmark = pytest.mark.graph


def test_a_run_announced_before_the_first_pose_is_not_missed(domain):
    with contextlib.closing(Client(domain)) as client:
        newest = LatestMessages(client.node, (PLANT_IMU, PLANT_ODOM, RUN))

        def publish(topic):
            publisher = client.node.create_publisher(
                topic.message_class, topic.name, reliable_qos(1, latched=True)
            )
            publisher.publish(topic.message_class())

        def take_until(condition):
            def look():
                taken.append(newest.take())
                return condition()

            taken = []
            client.spin_until(look)
            return taken

        publish(RUN)
        taken = take_until(lambda: newest[RUN] is not None)
        publish(PLANT_IMU)
        taken += take_until(lambda: newest[PLANT_IMU] is not None)
        assert all(now is None and not changed for now, changed in taken)
        publish(PLANT_ODOM)
        now, changed = take_until(lambda: newest[PLANT_ODOM] is not None)[-1]
        assert now is not None
        assert changed == {PLANT_IMU, PLANT_ODOM, RUN}
        assert newest.take()[1] == set()
        newest.close()
