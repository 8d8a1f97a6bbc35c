"""Pause, step, reset, pushes, parameters and diagnostics of a running graph."""

import math
import time

import pytest

rclpy = pytest.importorskip('rclpy')

from diagnostic_msgs.msg import DiagnosticArray  # noqa: E402
from geometry_msgs.msg import WrenchStamped  # noqa: E402
from rcl_interfaces.srv import DescribeParameters  # noqa: E402
from std_msgs.msg import Header, String  # noqa: E402
from std_srvs.srv import SetBool, Trigger  # noqa: E402

from ballbot_ros.messages.conversions import body_pitch, time_ns  # noqa: E402
from ballbot_ros.messages.topics import DIAGNOSTICS, OPERATING_STATE, PLANT_IMU, RUN  # noqa: E402
from ballbot_ros.nodes.node_parameters import NEXT_RUN  # noqa: E402
from ballbot_ros.parameters import NODES, RECORDER, Acts, parameters_of  # noqa: E402

pytestmark = pytest.mark.graph

GRAPH = [name for name in NODES if name != RECORDER]


@pytest.fixture
def graph(start_node, client):
    nodes = {name: start_node(name) for name in GRAPH}
    client.spin_until(lambda: {PLANT_IMU.name, RUN.name} <= set(client.newest))
    client.spin_until(lambda: client.now_ns() > 1_200_000_000)
    return nodes


def test_pause_stops_time_step_moves_one_tick_and_resume_goes_on(graph, client):
    assert client.call(SetBool, 'plant_sim/pause', SetBool.Request(data=True)).success
    client.spin_until(lambda: _is_still(client))
    before = client.now_ns()
    assert client.call(Trigger, 'plant_sim/step', Trigger.Request()).success
    client.spin_until(lambda: client.now_ns() > before)
    assert client.now_ns() == before + 4_000_000
    # Far longer than the timeout: a paused plant waits for nobody.
    deadline = time.monotonic() + 2.5
    client.spin_until(lambda: time.monotonic() > deadline)
    assert client.now_ns() == before + 4_000_000
    assert client.call(SetBool, 'plant_sim/pause', SetBool.Request(data=False)).success
    client.spin_until(lambda: client.now_ns() > before + 100_000_000)


def _is_still(client):
    before = client.now_ns()
    deadline = time.monotonic() + 0.3
    client.spin_until(lambda: time.monotonic() > deadline)
    return client.now_ns() == before


def test_a_step_while_it_runs_is_refused(graph, client):
    response = client.call(Trigger, 'plant_sim/step', Trigger.Request())
    assert not response.success
    assert 'pause' in response.message


def test_reset_begins_a_new_run_and_time_never_goes_back(graph, client):
    first: Header = client.newest[RUN.name]
    client.watch(OPERATING_STATE)
    before = client.now_ns()
    assert client.call(Trigger, 'plant_sim/reset', Trigger.Request()).success
    client.spin_until(lambda: client.newest[RUN.name].frame_id != first.frame_id)
    start = time_ns(client.newest[RUN.name].stamp)
    assert start > before
    assert start % 100_000_000 == 0
    client.spin_until(lambda: client.now_ns() > start + 1_200_000_000)
    states: list[String] = client.seen[OPERATING_STATE.name]
    assert [state.data for state in states][-2:] == ['calibration', 'remote']


def test_a_push_makes_it_lean(graph, client):
    publisher = client.node.create_publisher(WrenchStamped, 'plant/push', 10)
    client.spin_until(lambda: publisher.get_subscription_count() > 0)
    client.spin_until(lambda: client.now_ns() > 2_100_000_000)
    push = WrenchStamped()
    push.wrench.force.x = 2.0
    publisher.publish(push)

    def leans():
        psi_x, psi_y = body_pitch(client.newest[PLANT_IMU.name])
        return psi_x > math.radians(0.5) and abs(psi_y) < math.radians(0.2)

    client.spin_until(leans)


def test_every_parameter_is_described_with_its_range(graph, client):
    for name in GRAPH:
        rows = parameters_of(name)
        if not rows:
            continue
        request = DescribeParameters.Request(names=list(rows))
        response = client.call(DescribeParameters, f'{name}/describe_parameters', request)
        for row, descriptor in zip(rows.values(), response.descriptors, strict=True):
            assert row.description in descriptor.description
            assert descriptor.read_only == (row.acts is Acts.NEVER)
            is_range = row.bounds and not row.choices
            scalar = is_range and not row.or_zero and not isinstance(row.default, tuple)
            told = row.choices_text if row.choices else row.bounds_text if is_range else ''
            if not scalar:
                assert descriptor.additional_constraints.endswith(told)
            ranges = [*descriptor.floating_point_range, *descriptor.integer_range]
            assert [(r.from_value, r.to_value) for r in ranges] == [row.bounds] * bool(scalar)


def test_live_parameters_are_set_and_checked(graph, client):
    assert client.set_value('plant_sim', 'real_time_factor', 2.0).successful
    assert not client.set_value('plant_sim', 'real_time_factor', -1.0).successful
    assert client.set_value('plant_sim', 'gravity', 3.0).reason == NEXT_RUN


def test_every_node_reports_diagnostics(graph, client):
    client.watch(DIAGNOSTICS, depth=100)

    def nodes_seen():
        reports: list[DiagnosticArray] = client.seen.get(DIAGNOSTICS.name, [])
        return {status.name.partition(':')[0] for report in reports for status in report.status}

    client.spin_until(lambda: nodes_seen() == {f'/{name}' for name in GRAPH})
    status = client.seen[DIAGNOSTICS.name][-1].status[0]
    assert {'role', 'rate [Hz]', 'age [s]'} <= {value.key for value in status.values}
    assert status.level in (status.OK, status.WARN)  # a busy machine may be late
