"""Nodes that are started by hand, and restarted in mid-run."""

import contextlib
import signal
from types import MappingProxyType

import numpy as np
import pytest
from graph import NODES, await_recording, wait_for

pytest.importorskip('rclpy')

from rclpy.qos import DurabilityPolicy
from ros_client import Client

from ballbot_ros.engine.trajectory import load_trajectory
from ballbot_ros.parameters.timing import FIRST_TICK_NS, SLOW_PERIOD_NS, TICK_NS
from ballbot_ros.recording.messages.devices import INPUT_READERS
from ballbot_ros.recording.messages.topics import DIAGNOSTICS, GYRO_IMU, PLANT_IMU, RUN_STATUS
from ballbot_ros.recording.reader import RecordingReader

pytestmark = pytest.mark.graph

BALANCING_NS = FIRST_TICK_NS + 1_100_000_000
START_PITCH = 0.06981317007977318
OTHERS = [name for name in NODES if name not in ('plant_sim', 'recorder')]
VICTIMS = ['gyro_driver', 'sonar_driver']
"""A driver that answers every tick, and one that does not; simulation/test_robot_world.py tests
all."""


@pytest.fixture
def client(domain):
    with contextlib.closing(Client(domain)) as client:
        client.watch(PLANT_IMU)
        client.watch(RUN_STATUS)
        yield client


@pytest.fixture
def start_graph(start_node, tmp_path):
    """Start every node by hand; the plant's summary comes from its trajectory file.

    The run keeps pace with the wall clock: at full speed it could end before a node is killed.
    """

    def start(duration, dead_times=MappingProxyType({}), **plant):
        nodes = {name: start_node(name, **dead_times.get(name, {})) for name in OTHERS}
        nodes['recorder'] = start_node('recorder', output=tmp_path / 'run.mcap')
        nodes['plant_sim'] = start_node(
            'plant_sim',
            duration=duration,
            start_pitch_x=START_PITCH,
            real_time_factor=1.0,
            require_recorder='true',
            trajectory_file=tmp_path / 'trajectory.npz',
            **plant,
        )
        return nodes

    return start


def undisturbed(ticks, dead_times=MappingProxyType({})):
    from ballbot_ros.engine.closed_loop import ClosedLoop
    from ballbot_ros.engine.trajectory import TrajectoryLog
    from ballbot_ros.parameters import PLANT, ParameterSet

    parameters = ParameterSet()
    parameters.set(PLANT, 'start_pitch_x', START_PITCH)
    for node, values in dead_times.items():
        for name, value in values.items():
            parameters.set(node, name, value)
    loop, log = ClosedLoop(parameters), TrajectoryLog()
    for _ in range(ticks):
        tick = loop.tick()
        log.add(tick.truth, *tick.outputs.duty)
    return log


def await_standstill(client):
    """Wait until no more ticks come; return the stamp of the last one [ns]."""
    client.await_standstill()
    return client.now_ns()


@contextlib.contextmanager
def held_up(recorder, client):
    """Stop the recorder until the plant has its maximum lead and waits.

    It is stopped for at least a second: once in this interval the middleware looks for dead
    processes, and discards their unread samples.
    """
    recorder.process.send_signal(signal.SIGSTOP)
    # While it waits for the recorder, the plant repeats the status of the run.
    client.seen[RUN_STATUS.name] = []
    client.spin_until(lambda: len(client.seen[RUN_STATUS.name]) > 12, what='a second of waiting')
    yield
    recorder.process.send_signal(signal.SIGCONT)


def test_restarted_drivers_and_a_second_plant_change_no_duty(
    client, start_graph, start_node, tmp_path
):
    ticks = 750
    # The timeout leaves enough time for a restart on a busy machine.
    nodes = start_graph(ticks * TICK_NS * 1e-9, timeout=60.0)
    restarts = {}
    client.spin_until(lambda: PLANT_IMU.name in client.newest, what='the first tick')
    client.spin_until(lambda: client.now_ns() > BALANCING_NS, what='the end of calibration')
    second = start_node('plant_sim', duration=6.0, real_time_factor=0.0)
    for victim in VICTIMS:
        # Stop the recorder, so that samples of the victim are on their way to it when it dies.
        with held_up(nodes['recorder'], client):
            nodes[victim].kill()
        stopped = await_standstill(client)
        restarts[victim] = (stopped - FIRST_TICK_NS) // TICK_NS
        if victim == VICTIMS[-1]:  # the first plant can't have ended before the second
            assert second.finish() == 2
        start_node(victim)
        client.spin_until(
            lambda stopped=stopped: client.now_ns() > stopped + 2 * SLOW_PERIOD_NS,
            what=f'a tick after the restart of {victim}',
        )
    assert 'another plant' in second.output
    assert 'Traceback' not in second.output
    assert nodes['plant_sim'].finish() == 0, nodes['plant_sim'].output
    trajectory, summary = load_trajectory(tmp_path / 'trajectory.npz')
    assert summary['outcome'] == 'completed'
    expected = undisturbed(ticks)
    changed = (trajectory.duty != expected.trajectory().duty).any(axis=1)
    assert not changed.any(), f'from tick {np.argmax(changed)} on; killed at the ticks {restarts}'
    assert summary['duty_sha256'] == expected.duty_sha256
    nodes['recorder'].interrupt()
    with RecordingReader(tmp_path / 'run.mcap') as reader:
        assert reader.complete, nodes['recorder'].output
        for topic in ('/motor_duty', '/plant/imu', '/gyro'):
            assert reader.topics()[topic].message_count == ticks


def test_a_restarted_driver_continues_with_the_same_dead_times(
    client, start_graph, start_node, tmp_path
):
    ticks = 500
    dead_times = {
        'gyro_driver': {'delay': 1, 'delay_jitter': 5},
        'encoder_driver': {'delay': 3},
        'sonar_driver': {'delay_jitter': 50},
    }
    nodes = start_graph(ticks * TICK_NS * 1e-9, dead_times, timeout=60.0)
    client.spin_until(lambda: PLANT_IMU.name in client.newest, what='the first tick')
    client.spin_until(lambda: client.now_ns() > BALANCING_NS, what='the end of calibration')
    for victim in VICTIMS:
        nodes[victim].kill()
        stopped = await_standstill(client)
        start_node(victim, **dead_times[victim])
        client.spin_until(lambda stopped=stopped: client.now_ns() > stopped, what='the next tick')
    assert nodes['plant_sim'].finish() == 0, nodes['plant_sim'].output
    _, summary = load_trajectory(tmp_path / 'trajectory.npz')
    assert summary['duty_sha256'] == undisturbed(ticks, dead_times).duty_sha256
    assert summary['duty_sha256'] != undisturbed(ticks).duty_sha256


def test_drivers_may_be_killed_together_and_before_they_are_discovered(
    client, start_graph, start_node
):
    nodes = start_graph(60.0, timeout=60.0)
    client.spin_until(lambda: PLANT_IMU.name in client.newest, what='the first tick')
    for driver in VICTIMS:
        nodes[driver].kill()
    stopped = await_standstill(client)
    # Count the publishers, since the middleware keeps killed ones in the graph for 20 s.
    known = client.node.count_publishers(GYRO_IMU.name)
    short_lived = [start_node(driver) for driver in VICTIMS]
    client.spin_until(lambda: client.node.count_publishers(GYRO_IMU.name) > known)
    for node in short_lived:
        node.kill()
    for driver in VICTIMS:
        start_node(driver)
    client.spin_until(
        lambda: client.now_ns() > stopped + 5 * SLOW_PERIOD_NS, what='a tick after the restart'
    )


def test_a_restarted_controller_fails_the_run_and_says_so(
    start_graph, start_node, client, tmp_path
):
    nodes = start_graph(60.0, timeout=60.0)
    await_recording(tmp_path / 'run.mcap')
    with held_up(nodes['recorder'], client):
        nodes['controller'].kill()
    second = start_node('controller')
    assert second.finish() == 1
    assert 'started in mid-run' in second.output
    assert nodes['plant_sim'].finish() == 1
    assert 'controller' in nodes['plant_sim'].output


def test_with_rejoin_a_restarted_controller_begins_from_its_initial_state(
    start_graph, start_node, client, tmp_path
):
    nodes = start_graph(5.0, timeout=60.0)
    await_recording(tmp_path / 'run.mcap')
    with held_up(nodes['recorder'], client):
        nodes['controller'].kill()
    client.watch(DIAGNOSTICS, depth=100)
    controller = start_node('controller', rejoin='true')
    # The timers of the new controller are in phase only after a forced release, for which the plant
    # has to ask again.
    client.await_diagnosis('controller', 'forced releases', lambda forced: int(forced) > 0)
    status = nodes['plant_sim'].finish()
    controller.interrupt()
    # The plant reports an error, since the run has the duties of two controllers.
    assert status == 1
    assert 'restarted at' in nodes['plant_sim'].output, controller.output


def test_a_new_controller_is_not_sent_samples_of_answered_ticks(client, start_node):
    # Kept samples of the first ticks would arrive topic by topic, and could look like repetitions.
    start_node('controller')
    for topic in INPUT_READERS:

        def subscriptions(topic=topic):
            return client.node.get_subscriptions_info_by_topic(topic.name)

        client.spin_until(subscriptions, what=f'the subscription to {topic.name}')
        (found,) = subscriptions()
        assert found.qos_profile.durability == DurabilityPolicy.VOLATILE


@pytest.mark.parametrize('name', NODES)
def test_a_node_stops_cleanly_on_a_signal(run_node, tmp_path, name):
    parameters = {'output': tmp_path / 'run.mcap'} if name == 'recorder' else {}
    node = run_node(name, **parameters)
    wait_for(lambda: _handles_sigint(node.process.pid), what='the start')
    assert node.interrupt() == 0
    assert 'Traceback' not in node.output


def _handles_sigint(pid):
    from pathlib import Path

    for line in Path(f'/proc/{pid}/status').read_text().splitlines():
        if line.startswith('SigCgt:'):
            return int(line.split()[1], 16) & (1 << 14)  # SIGTERM, as Python itself catches SIGINT
    return False
