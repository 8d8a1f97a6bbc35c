"""The events that the plant's node passes to the master of the run."""

from types import SimpleNamespace

import pytest

pytest.importorskip('rclpy')

from builtin_interfaces.msg import Time
from geometry_msgs.msg import WrenchStamped
from std_msgs.msg import Header
from std_srvs.srv import SetBool

from ballbot_ros.nodes.plant_sim import PlantEvents
from ballbot_ros.recording.messages.conversions import encode_duty, encode_stop
from ballbot_ros.recording.messages.run_reports import encode_parameter_event
from ballbot_ros.recording.messages.topics import (
    MOTOR_DUTY,
    PARAMETER_EVENTS,
    PARTICIPANTS,
    PUSH,
    RECORDER_ACK,
    ROLL_CALL,
    RUN,
)


def test_an_unreadable_announcement_is_logged_and_reveals_its_sender():
    events, warnings = [], []
    plant = SimpleNamespace(
        _node=SimpleNamespace(
            dispatch=events.append,
            warn_malformed=lambda topic, error: warnings.append(topic.name),
        ),
        _master=SimpleNamespace(on_unreadable_announcement='note it'),
    )
    PlantEvents._on_announcement(plant, b'no announcement')
    assert events == ['note it']
    assert warnings == [PARTICIPANTS.name]


class Node:
    """Stores the events, warnings, subscriptions and services of the plant's node."""

    def __init__(self, *, is_lockstep=True):
        names = (
            'on_duty', 'on_ack', 'on_push', 'on_retuned', 'on_run', 'reset', 'start', 'set_paused',
            'step',
        )  # fmt: skip
        self.master = SimpleNamespace(
            is_lockstep=is_lockstep,
            pause=SimpleNamespace(is_paused=False, awaits_start=False),
            on_announcement='on_announcement',
            **{name: name for name in names},
        )
        self.events, self.warnings, self.depths = [], [], {}
        self.receive, self.services = {}, {}
        PlantEvents(self)

    def subscribe(self, topic, callback, *, depth=1, raw=False):
        self.receive[topic], self.depths[topic] = callback, depth

    def create_service(self, kind, name, callback):
        self.services[name] = lambda request=None: callback(request, kind.Response())

    def dispatch(self, event, *what, **details):
        self.events.append((event, *what, *details.values()))

    def warn_malformed(self, topic, error):
        self.warnings.append(topic)


def test_messages_are_passed_to_the_master():
    node = Node()
    duty, stop = encode_duty(8, (50, 0)), encode_stop(9)
    event = encode_parameter_event(7, {'k_i': 2.0})
    push = WrenchStamped(header=Header(stamp=Time(sec=2)))
    push.wrench.force.y, push.wrench.torque.x = 1.0, 3.0
    for topic, message, event in (
        (MOTOR_DUTY, duty, ('on_duty', 8, (50, 0, 0), duty, False)),
        (MOTOR_DUTY, stop, ('on_duty', 9, (0, 0, 0), stop, True)),
        (MOTOR_DUTY, duty[:20], ('on_duty', 8, None, duty[:20], False)),
        (RECORDER_ACK, Header(stamp=Time(sec=2)), ('on_ack', 2_000_000_000)),
        (PUSH, push, ('on_push', 2_000_000_000, (0.0, -1.0), (0.0, 3.0))),
        (
            PARAMETER_EVENTS,
            encode_parameter_event(7, {'k_i': 2.0}),
            ('on_retuned', 7, {'k_i': 2.0}),
        ),
        (RUN, Header(frame_id='1 a'), ('on_run', '1 a', RUN.name)),
        (ROLL_CALL, Header(frame_id='2 b'), ('on_run', '2 b', ROLL_CALL.name)),
    ):
        node.receive[topic](message)
        assert node.events == [event], topic
        node.events.clear()
    for topic in (MOTOR_DUTY, PARAMETER_EVENTS):
        node.receive[topic](b'')
    assert (node.events, node.warnings) == ([], [MOTOR_DUTY, PARAMETER_EVENTS])
    # Every duty of a tick in lockstep is received, also one by another controller.
    assert node.depths[MOTOR_DUTY] > Node(is_lockstep=False).depths[MOTOR_DUTY]


def test_a_request_is_answered_with_what_it_leads_to():
    node = Node()
    for name, request, is_paused, success, text, event in (
        ('reset', None, False, True, 'a new run begins', ('reset',)),
        ('start', None, True, True, 'started', ('start',)),
        ('start', None, False, False, 'the run is not paused at its start', ('start',)),
        ('pause', SetBool.Request(data=True), False, True, 'paused', ('set_paused', True)),
        ('pause', SetBool.Request(data=False), True, True, 'running', ('set_paused', False)),
        ('step', None, True, True, 'one tick', ('step',)),
        ('step', None, False, False, 'pause the plant first', ('step',)),
    ):
        node.master.pause.is_paused = node.master.pause.awaits_start = is_paused
        answer = node.services[f'plant_sim/{name}'](request)
        assert (answer.success, answer.message) == (success, text)
        assert node.events.pop() == event, name
