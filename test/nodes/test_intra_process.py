"""Messages between the nodes of one process."""

from types import SimpleNamespace

import pytest

pytest.importorskip('rclpy')

from ballbot_ros.nodes import endpoints as module
from ballbot_ros.nodes.endpoints import IntraProcess, TopicPublisher, drain, intra_process
from ballbot_ros.parameters import CONTROLLER, GYRO, PLANT, RECORDER
from ballbot_ros.recording.messages.topics import (
    BATTERY_STATE,
    CLOCK,
    GYRO_IMU,
    LCD,
    MOTOR_DUTY,
    PARTICIPANTS,
    PLANT_SLOW_ODOM,
    RECORDER_ACK,
    TOPICS,
)


def test_only_the_topics_of_the_loop_whose_publisher_is_here_are_passed():
    with IntraProcess([PLANT, CONTROLLER, RECORDER]):
        passed = {topic for topic in TOPICS if intra_process(topic)}
        assert {CLOCK, PLANT_SLOW_ODOM, BATTERY_STATE, MOTOR_DUTY, RECORDER_ACK} <= passed
        assert passed.isdisjoint({GYRO_IMU, LCD, PARTICIPANTS})
        with IntraProcess([GYRO]):
            assert intra_process(GYRO_IMU)
            assert intra_process(CLOCK) is None
        assert intra_process(CLOCK)
    assert intra_process(CLOCK) is None


def test_messages_arrive_in_the_order_of_publication_also_those_of_callbacks():
    within, heard = IntraProcess([]), []

    def answer(data):
        heard.append(data)
        if len(data) < 3:
            within.publish('/a', data + b'x', 1)

    within.subscribe('/a', answer)
    within.subscribe('/b', heard.append)
    for name in ('/a', '/b', '/nobody'):
        within.publish(name, name.encode(), 1)
    assert heard == []
    assert not within.deliver()
    assert heard == [b'/a', b'/b', b'/ax']


def test_the_executor_gets_its_turn(monkeypatch):
    times = (0.4 * module.TURN_S * number for number in range(1000))
    monkeypatch.setattr(module, 'time', SimpleNamespace(monotonic=times.__next__))
    within, heard = IntraProcess([]), []
    within.subscribe('/a', heard.append)
    for number in range(5):
        within.publish('/a', bytes([number]), 1)
    assert within.deliver()
    assert len(heard) == 3
    assert not within.deliver()
    assert [data[0] for data in heard] == [0, 1, 2, 3, 4]


def test_an_inbox_has_what_was_published_at_once_with_the_metadata_of_the_middleware():
    within = IntraProcess([])
    inbox = within.inbox('/a')
    within.publish('/a', b'one', 7)
    within.publish('/a', b'two', 8)
    (one, first), (two, second) = drain(inbox)
    assert (one, two) == (b'one', b'two')
    assert [each['publication_sequence_number'] for each in (first, second)] == [7, 8]
    assert first['received_timestamp'] <= second['received_timestamp']
    assert list(drain(inbox)) == []


class Node:
    """Creates publishers that store what reaches the middleware."""

    def __init__(self):
        self.readers = 0
        self.sent = []

    def resolve_topic_name(self, name):
        return f'/{name}'

    def create_publisher(self, kind, name, qos):
        return SimpleNamespace(
            publish=lambda data: self.sent.append((name, data)),
            get_subscription_count=lambda: self.readers,
        )

    def destroy_publisher(self, publisher):
        pass


def test_the_middleware_gets_what_somebody_outside_reads_and_what_late_subscribers_get():
    node = Node()
    with IntraProcess([CONTROLLER, PLANT]) as within:
        duty, battery = TopicPublisher(node, MOTOR_DUTY), TopicPublisher(node, BATTERY_STATE)
        inbox = within.inbox('/motor_duty')
        duty.publish(b'1')
        node.readers = 1
        duty.publish(b'1b')  # the executor has not had its turn
        within.deliver()
        duty.publish(b'2')
        node.readers = 0
        within.deliver()
        duty.publish(b'3')
        duty.recreate_publishers()
        duty.publish(b'4')
        battery.publish(b'5')
    numbers = [(data, each['publication_sequence_number']) for data, each in drain(inbox)]
    assert numbers == [(b'1', 1), (b'1b', 2), (b'2', 3), (b'3', 4), (b'4', 1)]
    assert node.sent == [
        ('motor_duty', b'2'), ('battery_state/_history', b'5'), ('battery_state', b'5'),
    ]  # fmt: skip
