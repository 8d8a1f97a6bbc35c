"""Pause, step, reset, pushes, parameters and diagnostics of a running graph."""

import contextlib
import math

import pytest
from graph import Node, free_domain

rclpy = pytest.importorskip('rclpy')

from diagnostic_msgs.msg import DiagnosticArray  # noqa: E402
from geometry_msgs.msg import WrenchStamped  # noqa: E402
from rcl_interfaces.srv import DescribeParameters  # noqa: E402
from ros_client import Client  # noqa: E402
from std_srvs.srv import SetBool, Trigger  # noqa: E402

from ballbot_ros.parameters import NODES, PLANT, RECORDER, TakesEffect, parameters_of  # noqa: E402
from ballbot_ros.recording.messages.conversions import body_pitch, time_ns  # noqa: E402
from ballbot_ros.recording.messages.topics import (  # noqa: E402
    ACCEPTED_PUSH,
    DIAGNOSTICS,
    OPERATING_STATE,
    PLANT_IMU,
    RUN,
)

pytestmark = pytest.mark.graph

GRAPH = [name for name in NODES if name != RECORDER]
TIMEOUT_S = 0.5
CALIBRATED_NS = 1_200_000_000
PUSH_TICKS = 25


@pytest.fixture(scope='module')
def graph(fork_client):
    """A graph in real time for all tests of this module."""
    with contextlib.ExitStack() as stack:
        domain = stack.enter_context(free_domain())
        for name in GRAPH:
            parameters = {'on_timeout': 'wait', 'timeout': TIMEOUT_S} if name == PLANT else {}
            stack.callback(Node.fork(fork_client, domain, name, **parameters).kill)
        client = stack.enter_context(contextlib.closing(Client(domain)))
        for topic in (PLANT_IMU, RUN, OPERATING_STATE, ACCEPTED_PUSH, DIAGNOSTICS):
            client.watch(topic, depth=100)
        client.spin_until(lambda: {PLANT_IMU.name, RUN.name} <= set(client.newest))
        yield client


@pytest.fixture
def client(graph):
    """The client, in a new run for the test, of which it has seen the first tick."""
    before = graph.newest[RUN.name].frame_id
    assert graph.call(Trigger, 'plant_sim/reset', Trigger.Request()).success
    graph.spin_until(lambda: graph.newest[RUN.name].frame_id != before)
    graph.spin_until(lambda: graph.now_ns() >= start_of_run_ns(graph))
    graph.seen.clear()
    return graph


def start_of_run_ns(client):
    return time_ns(client.newest[RUN.name].stamp)


@pytest.fixture
def paused(client):
    """The client, once its run is calibrated and stands still."""
    client.spin_until(lambda: client.now_ns() > start_of_run_ns(client) + CALIBRATED_NS)
    assert client.call(SetBool, 'plant_sim/pause', SetBool.Request(data=True)).success
    client.await_standstill()
    yield client
    assert client.call(SetBool, 'plant_sim/pause', SetBool.Request(data=False)).success


def step(client):
    before = client.now_ns()
    assert client.call(Trigger, 'plant_sim/step', Trigger.Request()).success
    client.spin_until(lambda: client.now_ns() > before)
    assert client.now_ns() == before + 4_000_000


def test_pause_stops_time_step_runs_one_tick_and_resume_continues(paused):
    step(paused)
    stepped = paused.now_ns()
    # The wait is longer than the timeout, which does not apply to a paused plant.
    paused.await_standstill()
    assert paused.now_ns() == stepped
    assert paused.call(SetBool, 'plant_sim/pause', SetBool.Request(data=False)).success
    paused.spin_until(lambda: paused.now_ns() > stepped + 100_000_000)


def test_a_push_makes_it_lean(paused):
    publisher = paused.node.create_publisher(WrenchStamped, 'plant/push', 10)
    paused.spin_until(lambda: publisher.get_subscription_count() > 0)
    push = WrenchStamped()
    push.wrench.force.x = 2.0
    publisher.publish(push)
    paused.spin_until(lambda: paused.seen.get(ACCEPTED_PUSH.name), what='the push')
    for _ in range(PUSH_TICKS):
        step(paused)
    psi_x, psi_y = body_pitch(paused.newest[PLANT_IMU.name])
    # The body leans backward: the controller drives the ball forward faster than the body falls.
    assert psi_x < -math.radians(0.5)
    assert abs(psi_y) < math.radians(0.01)


def test_every_parameter_is_described_with_its_range(client):
    for name in GRAPH:
        rows = parameters_of(name)
        if not rows:
            continue
        request = DescribeParameters.Request(names=list(rows))
        response = client.call(DescribeParameters, f'{name}/describe_parameters', request)
        for row, descriptor in zip(rows.values(), response.descriptors, strict=True):
            assert row.description in descriptor.description
            assert descriptor.read_only == (row.takes_effect is TakesEffect.READ_ONLY)
            is_range = row.bounds and not row.choices
            scalar = is_range and not row.or_zero and not isinstance(row.default, tuple)
            told = row.choices_text if row.choices else row.bounds_text if is_range else ''
            each = 'each within ' if is_range and isinstance(row.default, tuple) else ''
            expected = f'one of {told}' if row.choices else each + told
            assert descriptor.additional_constraints == ('' if scalar else expected)
            ranges = [*descriptor.floating_point_range, *descriptor.integer_range]
            assert [(r.from_value, r.to_value) for r in ranges] == [row.bounds] * bool(scalar)


def test_every_node_reports_diagnostics(client):
    def nodes_seen():
        reports: list[DiagnosticArray] = client.seen.get(DIAGNOSTICS.name, [])
        return {status.name.partition(':')[0] for report in reports for status in report.status}

    client.spin_until(lambda: nodes_seen() == {f'/{name}' for name in GRAPH})
    status = client.seen[DIAGNOSTICS.name][-1].status[0]
    assert {'role', 'rate [Hz]', 'age [s]'} <= {value.key for value in status.values}
    assert status.level in (status.OK, status.WARN)  # a busy machine may be late
