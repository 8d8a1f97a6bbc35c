"""A node that shows the graph handles messages in any order."""

import collections
import contextlib
import itertools
import math
from types import SimpleNamespace

import pytest

pytest.importorskip('rclpy')

from builtin_interfaces.msg import Time
from rclpy.serialization import serialize_message
from ros_client import Client
from std_msgs.msg import Header

from ballbot_ros.nodes import latest_messages
from ballbot_ros.nodes.endpoints import reliable_qos
from ballbot_ros.nodes.latest_messages import LatestMessages, snapshot_of
from ballbot_ros.parameters.timing import SECOND_NS
from ballbot_ros.recording.messages.conversions import encode_accepted_push
from ballbot_ros.recording.messages.topics import (
    ACCEPTED_PUSH,
    BATTERY_STATE,
    LCD,
    MAP,
    MOTOR_DUTY,
    OPERATING_STATE,
    PLANT_IMU,
    PLANT_ODOM,
    RUN,
    SESSION,
    SONAR_RANGE,
)
from ballbot_ros.robot.plant.ground_truth import Push
from ballbot_ros.viewer.run_activity import Session, encode_session

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
    newest = collections.defaultdict(lambda: None)
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


@pytest.fixture
def poll(monkeypatch):
    """Return a function that lets messages arrive and polls them.

    Stamps and times of publication grow with each poll; RUN and SESSION are names.
    """
    waiting, polls = {}, itertools.count(1)
    monkeypatch.setattr(latest_messages, 'hidden_node', lambda name, node: None)
    monkeypatch.setattr(latest_messages, 'raw_subscription', lambda node, topic, qos: topic)
    monkeypatch.setattr(latest_messages, 'drain', lambda topic: waiting.pop(topic, ()))
    topics = (
        PLANT_IMU,
        PLANT_ODOM,
        MOTOR_DUTY,
        ACCEPTED_PUSH,
        MAP,
        LCD,
        OPERATING_STATE,
        RUN,
        SESSION,
    )
    newest = LatestMessages(None, topics)

    def poll(messages):
        now_s = next(polls)
        for topic, content in messages.items():
            if topic is ACCEPTED_PUSH:
                waiting[topic] = [(data, {'source_timestamp': now_s}) for data in content]
                continue
            content, stamp_s = content if isinstance(content, tuple) else (content, now_s)
            data = bytes(serialize_message(message(topic, content, stamp_s)))
            waiting[topic] = [(data, {'source_timestamp': now_s})]
        return newest, newest.take()

    return poll


def message(topic, content, stamp_s):
    """Return a message with a stamp, and the content in its text."""
    stamp = Time(sec=stamp_s)
    if topic in (LCD, OPERATING_STATE, SESSION):
        return topic.message_class(data=content)
    if topic is RUN:
        return Header(frame_id=content, stamp=stamp)
    return topic.message_class(header=Header(frame_id=content, stamp=stamp))


POSE = {PLANT_IMU: 'pose', PLANT_ODOM: 'pose'}


def test_the_map_is_that_of_the_run_whatever_arrives_first(poll):
    """Each row is a poll: the messages that have arrived, and the map from then on."""
    for messages, expected in (
        ({MAP: 'a'}, 'a'),
        ({RUN: '1'}, 'a'),
        (POSE, 'a'),
        ({RUN: '2'}, None),
        ({MAP: 'b'}, 'b'),
        ({RUN: '3', MAP: 'c'}, 'c'),
        ({RUN: '4'}, None),
    ):
        newest, _ = poll(messages)
        shown = newest[MAP]
        assert (shown and shown.header.frame_id) == expected, messages


def test_a_new_run_discards_everything_of_the_run_before(poll):
    """Late answers of its nodes do not come back; what is new since the announcement is told."""
    poll({RUN: '1 a', **POSE})
    newest, (snapshot, _) = poll({MOTOR_DUTY: 'old', LCD: 'old', OPERATING_STATE: 'old'})
    assert snapshot.lcd == 'old'
    poll({RUN: '2 a', MOTOR_DUTY: 'old', **POSE})
    assert [newest[topic] for topic in (PLANT_IMU, PLANT_ODOM, MOTOR_DUTY, LCD)] == [None] * 4
    start_s = 3
    _, (snapshot, changed) = poll({MOTOR_DUTY: ('old', start_s - 1), LCD: 'new'})
    assert (snapshot, changed, newest[MOTOR_DUTY]) == (None, set(), None)
    _, (snapshot, changed) = poll({MOTOR_DUTY: 'new', **POSE})
    assert (snapshot.lcd, snapshot.state) == ('new', '')
    assert changed == {RUN, LCD, MOTOR_DUTY, PLANT_IMU, PLANT_ODOM}


def test_nothing_is_shown_between_the_request_of_a_run_and_its_announcement(poll):
    """The run before goes on until the command has stopped it."""
    poll({SESSION: encode_session('push')})
    newest, _ = poll({RUN: '1 a'})
    _, (snapshot, _) = poll({LCD: 'old', MAP: 'old', **POSE})
    assert snapshot is not None
    poll({SESSION: encode_session('push', {'outcome': 'passed', 'reason': ''})})
    assert newest.session.result.text == 'push: passed'
    _, (snapshot, _) = poll({})
    assert snapshot is not None, 'the end of a run stays on the page'
    _, (snapshot, _) = poll({SESSION: encode_session('square'), LCD: 'old', **POSE})
    assert snapshot is None
    assert newest.session == Session('square')
    _, (snapshot, _) = poll({LCD: 'old', OPERATING_STATE: 'old', MAP: 'old', **POSE})
    assert (snapshot, newest[MAP]) == (None, None)
    poll({RUN: '1 b', **POSE})
    _, (snapshot, changed) = poll(POSE)
    assert (snapshot.lcd, snapshot.state) == ('', '')
    assert changed == {RUN, PLANT_IMU, PLANT_ODOM}


def test_a_message_that_is_no_session_is_ignored(poll):
    for text in ('', '1', '{}', '{"scenario": "push", "result": {}}', '[' * 100_000):
        newest, _ = poll({SESSION: text})
        assert newest.session is None
        assert not newest.run.is_awaited


def test_start_and_end_of_a_push_arrive_together(poll):
    """Both are announced at its start; a new run forgets the pushes of the run before."""
    push = Push(2 * SECOND_NS, 3 * SECOND_NS, (1.0, -2.0), (0.0, 0.0))
    announced = [
        encode_accepted_push(stamp, push, 1, acts=stamp == push.start_ns)
        for stamp in (push.start_ns, push.end_ns)
    ]

    def force_at(stamp_s, messages):
        pose = dict.fromkeys(POSE, ('pose', stamp_s))
        _, (snapshot, _) = poll({**messages, **pose})
        return snapshot.force

    poll({RUN: '1 a'})
    assert force_at(1, {ACCEPTED_PUSH: announced}) == (0.0, 0.0)
    assert force_at(2, {}) == (1.0, -2.0)
    assert force_at(3, {}) == (0.0, 0.0)
    poll({RUN: ('2 a', 1)})
    assert force_at(2, {}) == (0.0, 0.0)
