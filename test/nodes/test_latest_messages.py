"""A node that shows the graph handles messages in any order."""

import contextlib
import math
from types import SimpleNamespace

import pytest

pytest.importorskip('rclpy')

from ros_client import Client

from ballbot_ros.messages.conversions import encode_accepted_push
from ballbot_ros.messages.raw import decoder
from ballbot_ros.messages.topics import (
    ACCEPTED_PUSH,
    BATTERY_STATE,
    LCD,
    MAP,
    MOTOR_DUTY,
    OPERATING_STATE,
    PLANT_IMU,
    PLANT_ODOM,
    RUN,
    SONAR_RANGE,
)
from ballbot_ros.nodes import latest_messages
from ballbot_ros.nodes.latest_messages import LatestMessages, snapshot_of
from ballbot_ros.nodes.topic_publisher import reliable_qos
from ballbot_ros.plant.ground_truth import Push
from ballbot_ros.timing import SECOND_NS

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
        hidden = {'/_test_client_inbox'}
        client.spin_until(lambda: not hidden & set(client.node.get_fully_qualified_node_names()))


def test_what_has_not_arrived_yet_is_unknown_in_the_state():
    newest = dict.fromkeys(
        (PLANT_IMU, PLANT_ODOM, MOTOR_DUTY, SONAR_RANGE, BATTERY_STATE, OPERATING_STATE, LCD)
    )
    assert snapshot_of(newest) is None
    newest[PLANT_IMU] = PLANT_IMU.message_class()
    assert snapshot_of(newest) is None
    newest[PLANT_ODOM] = PLANT_ODOM.message_class()
    newest[PLANT_ODOM].header.stamp.sec = 2
    bare = snapshot_of(newest)
    assert (bare.time, bare.position) == (2.0, (0.0, 0.0))
    assert all(map(math.isnan, (*bare.duty, bare.sonar, bare.battery)))
    assert (bare.cone_angle, bare.state, bare.lcd) == (0.0, '', '')
    newest |= {
        MOTOR_DUTY: SimpleNamespace(vector=SimpleNamespace(x=3.0, y=-4.0)),
        SONAR_RANGE: SimpleNamespace(range=0.5, field_of_view=0.25),
        BATTERY_STATE: SimpleNamespace(voltage=8.0),
        OPERATING_STATE: SimpleNamespace(data='remote'),
        LCD: SimpleNamespace(data='page'),
    }
    full = snapshot_of(newest)
    assert (full.duty, full.sonar, full.cone_angle) == ((3.0, -4.0), 0.5, 0.25)
    assert (full.battery, full.state, full.lcd) == (8.0, 'remote', 'page')


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


def test_start_and_end_of_a_push_arrive_together(monkeypatch):
    """Both are announced at its start; a new run forgets the pushes of the run before."""

    def decode_pushes(type_name):
        return decoder(type_name) if type_name == ACCEPTED_PUSH.type_name else lambda data: data

    waiting = {}
    monkeypatch.setattr(latest_messages, 'hidden_node', lambda *_: None)
    monkeypatch.setattr(latest_messages, 'raw_subscription', lambda _, topic, *__: topic)
    monkeypatch.setattr(latest_messages, 'drain', lambda topic: waiting.pop(topic, ()))
    monkeypatch.setattr(latest_messages, 'decoder', decode_pushes)
    newest = LatestMessages(None, (PLANT_IMU, PLANT_ODOM, RUN, ACCEPTED_PUSH))
    push = Push(SECOND_NS, 2 * SECOND_NS, (1.0, -2.0), (0.0, 0.0))
    start, end = (
        encode_accepted_push(stamp, push, 1, acts=stamp == push.start_ns)
        for stamp in (push.start_ns, push.end_ns)
    )
    body, ball = PLANT_IMU.message_class(), PLANT_ODOM.message_class()

    def force_at(seconds):
        ball.header.stamp.sec, ball.header.stamp.nanosec = int(seconds), round(seconds % 1 * 1e9)
        waiting[PLANT_IMU], waiting[PLANT_ODOM] = [(body, {})], [(ball, {})]
        return newest.take()[0].force

    waiting[ACCEPTED_PUSH] = [(start, {}), (end, {})]
    assert force_at(0.5) == (0.0, 0.0)
    assert force_at(1.5) == (1.0, -2.0)
    assert force_at(2.0) == (0.0, 0.0)
    waiting[RUN] = [(None, {})]
    assert force_at(1.5) == (0.0, 0.0)
