"""Who is silent: who does not answer new subscriptions, else who lacks the tick."""

import os
import signal

import pytest
import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from graph import wait_for

from ballbot_ros.cli.graph import ros
from ballbot_ros.messages.conversions import fill_time
from ballbot_ros.messages.topics import (
    DIAGNOSTICS,
    GAMEPAD_JOY,
    GYRO_IMU,
    JOINT_STATES,
    SONAR_RANGE,
)
from ballbot_ros.nodes.base import offered_qos
from ballbot_ros.nodes.participants import Participants
from ballbot_ros.parameters import CONTROLLER, GYRO, NODES, RECORDER, SONAR

pytestmark = pytest.mark.graph

TICK_NS = 1_100_000_000
EARLIER_NS = 1_000_000_000
IN_TIME = dict.fromkeys((GYRO_IMU, JOINT_STATES, SONAR_RANGE, GAMEPAD_JOY), TICK_NS)


@pytest.fixture
def node(domain, monkeypatch):
    monkeypatch.setenv('ROS_DOMAIN_ID', str(domain))
    with ros():
        made = rclpy.create_node('plant_sim')
        yield made
        made.destroy_node()


@pytest.fixture
def participants(node):
    looking = Participants(node)
    yield looking
    looking.rest()


def publish(node, topic, message):
    publisher = node.create_publisher(topic.message_class, topic.name, offered_qos(1))
    publisher.publish(message)


def report(node, *names):
    status = [DiagnosticStatus(name=f'{name}: loop') for name in names]
    publish(node, DIAGNOSTICS, DiagnosticArray(status=status))


def answer(node, stamps_ns):
    for topic, stamp_ns in stamps_ns.items():
        message = topic.message_class()
        fill_time(message.header.stamp, stamp_ns)
        publish(node, topic, message)


def silent(participants, expected, *, recorder):
    def answer_is_as_expected():
        participants.look()
        return participants.silent(TICK_NS, recorder=recorder) == expected

    wait_for(answer_is_as_expected, what=f'the silence of {expected}')


@pytest.mark.parametrize('recorder', [False, True])
def test_who_is_not_heard_is_silent_whatever_of_its_tick_has_come(node, participants, recorder):
    # As of a controller that is stopped with its duty on the way to the plant, not to the recorder.
    report(node, *(set(NODES) - {CONTROLLER}))
    answer(node, IN_TIME)
    silent(participants, CONTROLLER, recorder=recorder)


@pytest.mark.parametrize(
    ('late', 'expected'), [({SONAR_RANGE: EARLIER_NS, GYRO_IMU: EARLIER_NS}, f'{GYRO}, {SONAR}')]
)
def test_of_those_who_are_heard_it_is_who_lacks_the_tick(node, participants, late, expected):
    report(node, *NODES)
    answer(node, IN_TIME | late)
    silent(participants, expected, recorder=False)


@pytest.mark.parametrize(('recorder', 'expected'), [(False, CONTROLLER), (True, RECORDER)])
def test_if_all_are_heard_and_all_inputs_there_it_is_whose_answer_lacks(
    node, participants, recorder, expected
):
    report(node, *NODES)
    answer(node, IN_TIME)
    silent(participants, expected, recorder=recorder)


def test_what_was_heard_in_an_earlier_silence_does_not_count(node, participants, start_node):
    report(node, *(set(NODES) - {CONTROLLER}))
    # The controller reads these, too, and ignores what is in them.
    answer(node, IN_TIME)
    controller = start_node(CONTROLLER)
    silent(participants, RECORDER, recorder=True)
    os.kill(controller.process.pid, signal.SIGSTOP)
    participants.rest()
    silent(participants, CONTROLLER, recorder=True)
