"""A node that shows the graph handles messages in any order."""

import contextlib

import pytest

pytest.importorskip('rclpy')

from ros_client import Client

from ballbot_ros.messages.topics import MAP, PLANT_IMU, PLANT_ODOM, RUN
from ballbot_ros.nodes import latest_messages
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


def test_the_map_is_that_of_the_run_whatever_arrives_first(monkeypatch):
    """Each row is a poll: the messages that have arrived, and the map from then on."""
    waiting = {}
    monkeypatch.setattr(latest_messages, 'hidden_node', lambda name, node: None)
    monkeypatch.setattr(latest_messages, 'raw_subscription', lambda node, topic, qos: topic)
    monkeypatch.setattr(latest_messages, 'drain', lambda topic: waiting.pop(topic, ()))
    monkeypatch.setattr(latest_messages, 'decoder', lambda type_name: lambda data: data)
    for polls in (
        [({MAP: 'a'}, 'a'), ({RUN: 1}, 'a'), ({RUN: 2}, None), ({MAP: 'b'}, 'b')],
        [({RUN: 1}, None), ({MAP: 'a'}, 'a'), ({RUN: 2, MAP: 'b'}, 'b'), ({RUN: 3}, None)],
        [({RUN: 1, MAP: 'a'}, 'a'), ({}, 'a'), ({RUN: 2}, None), ({}, None)],
    ):
        newest = LatestMessages(None, (PLANT_IMU, PLANT_ODOM, MAP, RUN))
        for arrived, expected in polls:
            waiting.update({topic: [(data, {})] for topic, data in arrived.items()})
            newest.take()
            assert newest[MAP] == expected, (polls, arrived)
