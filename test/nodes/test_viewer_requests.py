"""Requests of the page to a graph that is not complete yet."""

import contextlib
from types import SimpleNamespace

import pytest

pytest.importorskip('rclpy')

from rcl_interfaces.msg import SetParametersResult
from rcl_interfaces.srv import GetParameters, SetParameters
from rclpy.parameter import Parameter
from ros_client import Client
from std_srvs.srv import SetBool, Trigger

from ballbot_ros.nodes import viewer_requests
from ballbot_ros.nodes.endpoints import TopicPublisher, reliable_qos
from ballbot_ros.nodes.viewer_requests import ViewerRequests
from ballbot_ros.parameters import PlantParameters
from ballbot_ros.recording.messages.conversions import encode_push
from ballbot_ros.recording.messages.run_reports import PlantReport
from ballbot_ros.recording.messages.topics import PUSH, RUN
from ballbot_ros.viewer.overlay import ChooseRate, Press, Seek
from ballbot_ros.viewer.run_activity import BACK, PAUSE, RESET, STEP, RunActivity, Session

pytestmark = pytest.mark.graph

HALF_SPEED = ChooseRate('0.5×')


def test_a_plant_of_any_name_is_queried_until_it_answers(domain):
    with contextlib.closing(Client(domain)) as client:
        client.node.output = lambda topic: TopicPublisher(client.node, topic)
        requests = ViewerRequests(client.node, print)
        answers = []
        requests.plant_parameters(['map'], answers.append)
        requests.send_queued()
        # Let the client's node pass for the plant, which is the node that announces runs.
        client.node.declare_parameter('map', 'the map')
        client.node.create_publisher(RUN.message_class, RUN.name, reliable_qos(1, latched=True))

        def is_answered():
            requests.send_queued()
            return answers

        client.spin_until(is_answered)
        assert answers == [PlantParameters(map='the map')]


def test_a_player_announces_runs_but_has_no_parameters_of_a_plant(domain):
    with contextlib.closing(Client(domain)) as client:
        client.node.output = lambda topic: TopicPublisher(client.node, topic)
        told, answers = [], []
        requests = ViewerRequests(client.node, told.append)
        client.node.create_publisher(RUN.message_class, RUN.name, reliable_qos(1, latched=True))
        requests.plant_parameters(['map'], answers.append)

        def is_found():
            found = requests._parameters.of_plant(SetParameters)
            return found and found.service_is_ready()

        client.spin_until(is_found)
        requests.carry_out(HALF_SPEED, RunActivity())
        client.spin_until(lambda: requests.send_queued() or told)
        assert told[0].startswith('parameters of plant_sim: ')
        requests.plant_parameters(['scenario', 'use_sim_time'], answers.append)
        client.spin_until(lambda: requests.send_queued() or requests._query is None)
        assert answers == []


def test_a_late_answer_to_an_earlier_query_is_ignored():
    calls = []

    def call(request):
        def answer(value):
            values = [Parameter('', value=value).get_parameter_value()]
            done[0](SimpleNamespace(result=lambda: GetParameters.Response(values=values)))

        done = []
        calls.append(answer)
        return SimpleNamespace(add_done_callback=done.append)

    client = SimpleNamespace(service_is_ready=lambda: True, call_async=call)
    plant = SimpleNamespace(node_namespace='/', node_name='plant_sim')
    node = SimpleNamespace(
        create_client=lambda kind, name: client,
        get_publishers_info_by_topic=lambda name: [plant],
        output=lambda topic: None,
    )
    requests = ViewerRequests(node, notify=None)
    answers = []
    for _ in range(2):
        requests.plant_parameters(['ball_radius'], answers.append)
        requests.send_queued()
    calls[0](0.05)
    assert answers == []
    calls[1](0.06)
    assert [each.ball_radius for each in answers] == [0.06]


class StubNode:
    """A graph whose services and plant are those that the test sets."""

    def __init__(self):
        self.ready, self.plant, self.clients = set(), '', set()
        self.called = []

    def create_client(self, kind, name):
        self.clients.add(name)
        return SimpleNamespace(
            name=name, service_is_ready=lambda: name in self.ready, call_async=self.call
        )

    def call(self, request):
        """Note a call: the function that receives its answer."""
        return SimpleNamespace(add_done_callback=self.called.append)

    def get_publishers_info_by_topic(self, name):
        return [SimpleNamespace(node_namespace='/', node_name=self.plant)] if self.plant else []

    def output(self, topic):
        return None


def test_the_plant_is_lost_once_it_was_there():
    node = StubNode()
    requests = ViewerRequests(node, notify=None)
    pause = {'plant_sim/pause'}
    services = (set(), pause, set(), set(), pause, set())
    found = []
    for node.ready in services:
        found.append(requests.lost_plant)
    assert found == [False, False, True, True, False, True]


def test_parameters_are_those_of_the_plant_that_announces_runs_now():
    node = StubNode()
    requests = ViewerRequests(node, notify=None)
    others = set(node.clients)
    assert requests._parameters.of_plant(SetParameters) is None
    for plant in ('plant_sim', 'plant_sim', 'another'):
        node.plant = plant
        client = requests._parameters.of_plant(SetParameters)
        assert client.name == f'/{plant}/set_parameters'
        services = {f'/{plant}/{name}' for name in ('set_parameters', 'get_parameters')}
        assert services <= node.clients - others


def test_a_query_is_repeated_once_a_second_until_it_is_answered(monkeypatch):
    """Each row is a moment, whether the service is ready, and the number of calls so far."""
    node, answers = StubNode(), []
    node.plant, service = 'plant_sim', '/plant_sim/get_parameters'
    requests = ViewerRequests(node, notify=None)
    requests.plant_parameters(['map'], answers.append)
    for now_s, is_ready, calls in (
        (10.0, False, 0), (10.0, True, 1), (10.9, True, 1), (11.0, True, 2), (11.9, False, 2),
        (12.5, False, 2), (12.6, True, 3),
    ):  # fmt: skip
        monkeypatch.setattr(
            viewer_requests, 'time', SimpleNamespace(monotonic=lambda now_s=now_s: now_s)
        )
        node.ready = {service} if is_ready else set()
        requests.send_queued()
        assert len(node.called) == calls, now_s
    values = [Parameter('', value='track').get_parameter_value()]
    node.called[-1](SimpleNamespace(result=lambda: GetParameters.Response(values=values)))
    assert answers == [PlantParameters(map='track')]
    monkeypatch.setattr(viewer_requests, 'time', SimpleNamespace(monotonic=lambda: 20.0))
    requests.send_queued()
    assert len(node.called) == 3


def test_a_scenario_is_chosen_before_it_is_started():
    node, told = StubNode(), []
    node.ready = {'supervisor/set_parameters', 'supervisor/start'}
    requests = ViewerRequests(node, told.append)
    requests.start('square')
    requests.send_queued()
    assert len(node.called) == 1
    node.called[0](SimpleNamespace(result=SetParameters.Response))
    assert len(node.called) == 2
    assert told == []
    for success in (True, False):
        response = Trigger.Response(success=success, message='unknown scenario')
        node.called[1](SimpleNamespace(result=lambda response=response: response))
    assert told == ['unknown scenario']


def test_a_run_goes_back_to_the_time_at_which_a_drag_ends(monkeypatch):
    """Each row is a moment, what is requested then, and the runs that have been begun so far."""
    node, begun = StubNode(), []
    node.ready = {'supervisor/set_parameters'}
    node.call = lambda request: (
        begun.append(request.parameters[0].value.string_value)
        or SimpleNamespace(add_done_callback=node.called.append)
    )
    requests = ViewerRequests(node, notify=None)
    running = RunActivity(Session('square'), report=PlantReport('1 a'), time=9.0)
    without_command = RunActivity(report=PlantReport('1 a'), time=9.0)
    for now_s, request, activity, expected in (
        (10.0, Seek(3.0), running, []),
        (10.2, Seek(4.5), running, []),
        (10.4, None, running, []),
        (10.6, None, running, ['@3.500']),
        (11.5, None, running, ['@3.500']),
        (12.0, Press(BACK), running, ['@3.500', '@3.000']),
        (13.0, Seek(0.5), running, ['@3.500', '@3.000']),
        (14.0, Seek(5.0), without_command, ['@3.500', '@3.000', '@0.000']),
        (15.0, None, running, ['@3.500', '@3.000', '@0.000']),
    ):
        monkeypatch.setattr(
            viewer_requests, 'time', SimpleNamespace(monotonic=lambda now_s=now_s: now_s)
        )
        requests.carry_out(request, activity)
        requests.send_queued()
        requests.send_queued()
        assert begun == expected, now_s


def test_each_request_is_sent_in_its_turn_to_its_service():
    node, told, sent = StubNode(), [], []
    node.now_ns = 8
    node.output = lambda topic: SimpleNamespace(publish=lambda data: sent.append((topic, data)))
    node.call = lambda request: (
        sent.append(request) or SimpleNamespace(add_done_callback=node.called.append)
    )
    node.ready = {f'plant_sim/{name}' for name in ('pause', 'step', 'reset')}
    requests = ViewerRequests(node, told.append)
    assert not requests.can_start
    node.ready |= {'supervisor/start', '/plant_sim/set_parameters'}
    assert requests.can_start
    paused = RunActivity(report=PlantReport('1 a', is_paused=True))
    for request, activity in (
        (Press(PAUSE), RunActivity()), (Press(PAUSE), paused), (Press(STEP), paused),
        (Press(RESET), RunActivity()), (Press('x'), RunActivity()), (ChooseRate('x'), paused),
        (Seek(1.0), paused),
    ):  # fmt: skip
        requests.carry_out(request, activity)
    requests.push((1.0, 0.0))
    requests.carry_out(HALF_SPEED, RunActivity())
    assert sent == []
    requests.send_queued()
    assert sent == [
        SetBool.Request(data=True), SetBool.Request(data=False), Trigger.Request(),
        Trigger.Request(), (PUSH, encode_push(8, (1.0, 0.0))),
    ]  # fmt: skip
    assert told == ['parameters of plant_sim: service not available']
    node.plant = 'plant_sim'
    requests.carry_out(HALF_SPEED, RunActivity())
    requests.carry_out(ChooseRate('max'), RunActivity())
    requests.send_queued()
    assert sent.pop().parameters[0].value.double_value == 0.0
    (parameter,) = sent[-1].parameters
    assert (parameter.name, parameter.value.double_value) == ('real_time_factor', 0.5)
    results = [SetParametersResult(successful=False, reason='too slow'),
               SetParametersResult(successful=True, reason='set')]  # fmt: skip
    node.called[-1](SimpleNamespace(result=lambda: SetParameters.Response(results=results)))
    assert told[1:] == ['parameters of plant_sim: too slow']
    node.ready = set()
    requests.carry_out(Press(RESET), RunActivity())
    requests.send_queued()
    assert told[2:] == ['plant_sim/reset: service not available']
