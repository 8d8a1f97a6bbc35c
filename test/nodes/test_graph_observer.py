"""What a node sees of the graph."""

import importlib
from pathlib import Path
from types import SimpleNamespace

import pytest
from graph import occupied

pytest.importorskip('rclpy')

import rclpy

from ballbot_ros.lockstep.participants import Publisher
from ballbot_ros.nodes import participation as graph_observer
from ballbot_ros.nodes.endpoints import hidden_node
from ballbot_ros.nodes.middleware import DISCOVERY_RANGE
from ballbot_ros.nodes.participation import GraphObserver
from ballbot_ros.parameters import GYRO
from ballbot_ros.recording.messages.conversions import encode_duty
from ballbot_ros.recording.messages.topics import GYRO_IMU, JOINT_STATES, MOTOR_DUTY

pytestmark = pytest.mark.graph

EXAMPLES = Path(__file__).parents[2] / 'docs/examples'


def test_discovery_is_complete_once_every_participant_of_this_machine_is_known(
    domain, client, start_node
):
    observer = GraphObserver(client.node, ())
    assert observer.is_complete()
    port = 7400 + 250 * domain + 10 + 2 * 20
    with occupied(port), occupied(port + 1):  # a participant that announces nothing
        assert not observer.is_complete()
    start_node(GYRO)
    client.spin_until(lambda: '/gyro_driver' in observer_names(client) and observer.is_complete())


def test_a_hidden_node_offers_nothing_and_has_a_name_of_its_own(domain):
    context = rclpy.Context()
    arguments = ['--ros-args', '-r', '__node:=renamed']
    rclpy.init(args=arguments, context=context, domain_id=domain)
    try:
        owner = rclpy.create_node('owner', context=context, namespace='/robot')
        inbox = hidden_node('inbox', owner)
        assert inbox.get_fully_qualified_name() == '/robot/_renamed_inbox'
        assert owner.count_publishers('/rosout') == 1
        assert not [each for each in inbox.services if 'parameter' in each.service_name]
        for node in (inbox, owner):
            node.destroy_node()
    finally:
        context.try_shutdown()


GYRO_OFFER, UNKNOWN_OFFER = (
    SimpleNamespace(endpoint_gid=[7] * 16, node_namespace='/', node_name=name)
    for name in ('gyro_driver', '_NODE_NAME_UNKNOWN_')
)


def test_publishers_are_listed_again_if_their_number_changes_or_after_a_second(monkeypatch):
    """Each row is a moment, the offers, and whether they are listed then."""
    for rows in (
        [(0.0, [], True), (0.5, [], False), (0.6, [GYRO_OFFER], True), (1.5, [GYRO_OFFER], False),
         (1.6, [GYRO_OFFER], True)],
        [(0.0, [UNKNOWN_OFFER], True), (0.1, [UNKNOWN_OFFER], True), (0.2, [GYRO_OFFER], True),
         (0.3, [GYRO_OFFER], False)],
    ):  # fmt: skip
        offers, listed = [], []
        node = SimpleNamespace(
            count_publishers=lambda name: len(offers),  # noqa: B023
            get_publishers_info_by_topic=lambda name: listed.append(name) or offers,  # noqa: B023
        )
        observer = GraphObserver(node, [GYRO_IMU])
        for now_s, offers, is_listed in rows:
            monkeypatch.setattr(
                graph_observer, 'time', SimpleNamespace(monotonic=lambda now_s=now_s: now_s)
            )
            listed.clear()
            found = observer.publishers()
            assert bool(listed) == is_listed, now_s
            names = ['/gyro_driver'] if GYRO_OFFER in offers else [''] * len(offers)
            assert found == {GYRO_IMU.name: [Publisher(bytes([7] * 16), name) for name in names]}


def test_a_publisher_without_a_ros_node_is_called_a_program_without_ros(domain, client):
    pytest.importorskip('cyclonedds')
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(EXAMPLES)
        example = importlib.import_module('cyclonedds_encoder_driver')
        patch.setenv('ROS_DOMAIN_ID', str(domain))
        patch.setenv('CYCLONEDDS_URI', example.LOCALHOST)
        driver = example.EncoderDriver()
    observer = GraphObserver(client.node, [JOINT_STATES])
    client.spin_until(lambda: observer.publishers()[JOINT_STATES.name])
    (found,) = observer.publishers()[JOINT_STATES.name]
    assert found.node == 'a program without ROS'
    assert found.gid.hex().startswith(driver.dds.guid.bytes[:12].hex())


def test_messages_are_received_from_the_first_question_until_the_last(monkeypatch):
    made, waiting = [], []
    inbox = SimpleNamespace(destroy_node=lambda: made.append('destroyed'))
    monkeypatch.setattr(graph_observer, 'hidden_node', lambda *_: made.append('node') or inbox)
    monkeypatch.setattr(
        graph_observer, 'raw_subscription', lambda node, topic, qos: made.append(topic) or topic
    )
    monkeypatch.setattr(graph_observer, 'drain', lambda topic: [(data, {}) for data in waiting])
    observer = GraphObserver(None, [GYRO_IMU, MOTOR_DUTY])
    observer.stop_listening()
    assert observer.received([]) == made == []
    waiting += [encode_duty(8, (1, 2)), b'']
    for _ in range(2):
        assert observer.received([MOTOR_DUTY.name]) == [(MOTOR_DUTY.name, 8)]
    assert made == ['node', MOTOR_DUTY]
    observer.received([GYRO_IMU.name])
    assert made == ['node', MOTOR_DUTY, GYRO_IMU]
    observer.stop_listening()
    observer.stop_listening()
    observer.received([MOTOR_DUTY.name])
    assert made[3:] == ['destroyed', 'node', MOTOR_DUTY]


@pytest.mark.parametrize(('gids', 'prefix'), [([b'ab', b'ab'], 'ab'), ([b'ab', b'ac'], '')])
def test_the_nodes_of_a_process_share_a_prefix(gids, prefix):
    destroyed = []
    node = SimpleNamespace(
        create_publisher=lambda *_: 'publisher',
        destroy_publisher=destroyed.append,
        get_publishers_info_by_topic=lambda name: [
            SimpleNamespace(endpoint_gid=[*bytes.fromhex(gid.decode() * 12), number, 1])
            for number, gid in enumerate(gids)
        ],
    )
    assert graph_observer.guid_prefix(node, 'word') == prefix * 12
    assert destroyed == ['publisher'] * 2


def observer_names(client):
    return [f'{space}{name}' for name, space in client.node.get_node_names_and_namespaces()]


def test_it_cannot_be_known_to_be_complete_beyond_this_machine(client, monkeypatch):
    observer = GraphObserver(client.node, ())
    assert observer.is_complete()
    monkeypatch.setenv(DISCOVERY_RANGE, 'SUBNET')
    assert not observer.is_complete()
