"""What the page can tune, and its requests, with a stand-in for the controller."""

import contextlib
import math

import pytest

pytest.importorskip('rclpy')

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rcl_interfaces.msg import SetParametersResult as Result
from ros_client import Client

from ballbot_ros.lockstep.participants import Announcement, Participant
from ballbot_ros.nodes.base import BallbotNode
from ballbot_ros.nodes.endpoints import reliable_qos
from ballbot_ros.nodes.viewer_requests import TuningRequests
from ballbot_ros.recording.messages.run_reports import encode_announcement, encode_parameter_event
from ballbot_ros.recording.messages.topics import HISTORY, PARAMETER_EVENTS, PARTICIPANTS
from ballbot_ros.viewer.tuning_sliders import Tunable

pytestmark = pytest.mark.graph


class Sliders:
    """A stand-in for the sliders, whose calls are recorded."""

    def __init__(self):
        self.shown, self.followed, self.wanted = [], [], {}

    def show(self, tunables):
        self.shown.append(tunables)

    def follow(self, values):
        self.followed.append(values)

    def take(self):
        wanted, self.wanted = self.wanted, {}
        return wanted


class Page:
    """The requests of a page, and a node that passes for the controller and its graph."""

    def __init__(self, client):
        self.client, self.told, self.set = client, [], []
        client.node.warn_malformed = lambda topic, error: self.told.append(str(error))
        client.node.subscribe = lambda *args, **kinds: BallbotNode.subscribe(
            client.node, *args, **kinds
        )
        self.sliders = Sliders()
        self.requests = TuningRequests(client.node, self.told.append, self.sliders)
        self.participants = client.node.create_publisher(
            PARTICIPANTS.message_class, PARTICIPANTS.name, reliable_qos(HISTORY, latched=True)
        )
        self.events = client.node.create_publisher(
            PARAMETER_EVENTS.message_class, PARAMETER_EVENTS.name, reliable_qos(10, latched=False)
        )
        self.until(self.events.get_subscription_count, what='the subscription')

    def declare(self):
        node = self.client.node
        low, high = FloatingPointRange(from_value=0.0, to_value=9.0), IntegerRange(to_value=50)
        for name, value, described in (
            ('gain', 2.0, {'description': 'a gain [V]', 'floating_point_range': [low]}),
            ('row', [1.0, 2.0], {}),
            ('count', 7, {'integer_range': [high]}),
            ('word', 'x', {}),
        ):
            node.declare_parameter(name, value, ParameterDescriptor(**described))
        node.add_on_set_parameters_callback(self._on_set)

    def _on_set(self, parameters):
        self.set += [
            (each.name, list(each.value) if hasattr(each.value, '__len__') else each.value)
            for each in parameters
        ]
        if any(each.name == 'count' for each in parameters):
            return Result(successful=False, reason='controller.count: no')
        if any('garbage' in str(each.value) for each in parameters):
            return Result(successful=False, reason='gyro_driver.faults: no')
        return Result(successful=True)

    def announce(self, run='1', role='controller', *, tunable, **values):
        participant = Participant(
            role, self.client.node.get_fully_qualified_name(), 'host', 1, 'abc', 'mine 1', '',
            parameters={'tunable': tunable, **values},
        )  # fmt: skip
        self.participants.publish(encode_announcement(Announcement(participant, run)))

    def until(self, condition, what):
        self.client.spin_until(lambda: self.requests.send_queued() or condition(), what)


@pytest.fixture
def page(domain):
    with contextlib.closing(Client(domain)) as client:
        yield Page(client)


def test_it_shows_what_the_controller_declares_as_tunable(page):
    page.declare()
    page.announce(tunable=['gain', 'row', 'count', 'word'], gain=1.0, row=[0.5, 2.0], count='?')
    page.until(lambda: page.sliders.shown, what='the sliders')
    (shown,) = page.sliders.shown
    assert shown == [
        Tunable('gain', 'a gain [V]', 0.0, 9.0, (1.0,), (2.0,)),
        Tunable('row', '', -float('inf'), float('inf'), (0.5, 2.0), (1.0, 2.0), is_array=True),
        Tunable('count', '', 0, 50, (7,), (7,), is_whole=True),
    ]


@pytest.mark.parametrize('tunable', [[], None, 'gain', [1, 2]])
def test_a_controller_without_tunable_parameters_has_no_sliders(page, tunable):
    page.declare()
    page.announce(tunable=tunable)
    page.until(lambda: page.sliders.shown, what='the sliders')
    assert page.sliders.shown == [[]]


def test_each_run_is_asked_once_and_only_the_controller(page):
    page.declare()
    page.announce(role='gyro_driver', tunable=['gain'])
    page.announce(tunable=['gain'])
    page.announce(tunable=['gain'])
    page.until(lambda: page.sliders.shown, what='the sliders')
    page.announce('2', tunable=['count'])
    page.until(lambda: len(page.sliders.shown) == 2, what='those of the next run')
    assert [[each.name for each in shown] for shown in page.sliders.shown] == [['gain'], ['count']]


def test_wanted_values_are_set_and_refused_ones_are_told_and_taken_back(page):
    page.declare()
    page.announce(tunable=['gain', 'row', 'count'])
    page.until(lambda: page.sliders.shown, what='the sliders')
    page.sliders.wanted = {'gain': (3.0,), 'row': (4.0, 5.0), 'other': (1.0,)}
    page.until(lambda: len(page.set) == 2, what='the values')
    assert page.set == [('gain', 3.0), ('row', [4.0, 5.0])]
    page.sliders.wanted = {'count': (8,)}
    page.until(lambda: page.sliders.followed, what='the refusal')
    assert page.told == ['controller.count: no']
    assert page.sliders.followed == [{'count': (7,)}]


def test_sliders_follow_changes_from_elsewhere(page):
    page.declare()
    page.announce(tunable=['gain', 'row'])
    page.until(lambda: page.sliders.shown, what='the sliders')
    events = (
        {'gain': 'x'}, {'gain': math.nan}, {'gain': True}, {'row': (1.0,)}, {'row': 1.0},
        {'gain': 5.0, 'k_i': 1.0}, {'row': (3.0, 1.0)},
    )  # fmt: skip
    for values in events:
        page.events.publish(encode_parameter_event(5, values))
    page.until(lambda: len(page.sliders.followed) == 2, what='the changes')
    assert page.sliders.followed == [{'gain': (5.0,)}, {'row': (3.0, 1.0)}]


def test_a_slider_in_motion_is_left_alone_and_then_shows_what_is_in_effect(page, monkeypatch):
    """Events of its earlier values arrive while it moves on; some values cause no event."""
    page.declare()
    page.announce(tunable=['gain'])
    page.until(lambda: page.sliders.shown, what='the sliders')
    monkeypatch.setattr('ballbot_ros.nodes.viewer_requests.SETTLE_S', math.inf)
    for value in (3.0, 4.0):
        page.sliders.wanted = {'gain': (value,)}
        page.until(lambda value=value: ('gain', value) in page.set, what='the value')
    page.events.publish(encode_parameter_event(5, {'gain': 3.0}))
    page.until(lambda: page.requests._present['gain'] == (3.0,), what='the event')
    assert page.sliders.followed == []
    page.events.publish(encode_parameter_event(6, {'gain': 4.0}))
    page.until(lambda: page.requests._present['gain'] == (4.0,), what='the event')
    monkeypatch.setattr('ballbot_ros.nodes.viewer_requests.SETTLE_S', 0.0)
    page.until(lambda: page.sliders.followed, what='the value in effect')
    assert page.sliders.followed == [{'gain': (4.0,)}]


def test_malformed_messages_are_told(page):
    page.events.publish(b'\0\1\0\0')
    page.participants.publish(b'\0\1\0\0')
    page.until(lambda: len(page.told) == 2, what='the warnings')
    assert page.sliders.shown == page.sliders.followed == []


def test_faults_are_added_to_those_of_their_node_and_refusals_are_told(page):
    node = page.client.node
    node.declare_parameter('faults', '')
    node.add_on_set_parameters_callback(page._on_set)
    for text in ('gyro_x weak', 'sonar off'):
        page.requests.add_fault(text)
    page.until(lambda: len(page.told) == 2, what='the mistakes')
    assert page.told[0].startswith('gyro_x weak: only motor can have this')
    assert page.told[1] == 'sonar_driver takes no part in the run'
    for role, text in (('gyro_driver', 'gyro_y off time=1'), ('controller', '')):
        page.announce(role=role, tunable=[], faults=text)
        page.until(lambda role=role: role in page.requests._participants, what='the participant')
    (client,) = page.requests._clients._clients.values()
    page.client.spin_until(client.service_is_ready)
    for text in ('gyro_x stuck duration=2', 'task_ts1 slow'):
        page.requests.add_fault(text)
    page.until(lambda: len(page.set) == 2, what='the faults')
    texts = [''.join(value) for _, value in page.set]
    assert texts == ['gyro_y off time=1; gyro_x stuck duration=2', 'task_ts1 slow']
    page.requests.add_fault('gyro_x garbage')
    page.until(lambda: len(page.told) == 3, what='the refusal')
    assert page.told[2] == 'gyro_driver.faults: no'
