"""Nodes that are started by hand, and restarted in mid-run."""

import contextlib
import signal

import numpy as np
import pytest
from graph import NODES, await_recording

pytest.importorskip('rclpy')

from ballbot_ros.engine.closed_loop import ClosedLoop
from ballbot_ros.engine.trajectory import TrajectoryLog, load_trajectory
from ballbot_ros.parameters import PLANT, ParameterSet
from ballbot_ros.parameters.timing import FIRST_TICK_NS, SLOW_PERIOD_NS, TICK_NS
from ballbot_ros.recording.messages.topics import DIAGNOSTICS, GYRO_IMU, PLANT_IMU, RUN_STATUS
from ballbot_ros.recording.reader import RecordingReader

pytestmark = pytest.mark.graph

BALANCING_NS = FIRST_TICK_NS + 1_100_000_000
START_PITCH = 0.06981317007977318
OTHERS = [name for name in NODES if name not in ('plant_sim', 'recorder')]
VICTIMS = ['gyro_driver', 'sonar_driver']
"""A driver that answers every tick, and one that does not; lockstep/test_robot_world.py tests
all, also with dead times."""


@pytest.fixture
def client(client):
    client.watch(RUN_STATUS)
    return client


@pytest.fixture
def start_graph(start_node, tmp_path):
    """Start every node by hand; the plant's summary comes from its trajectory file.

    The run keeps pace with the wall clock: at full speed it could end before a node is killed.
    """

    def start(duration):
        nodes = {name: start_node(name) for name in OTHERS}
        nodes['recorder'] = start_node('recorder', output=tmp_path / 'run.mcap')
        nodes['plant_sim'] = start_node(
            'plant_sim',
            duration=duration,
            start_pitch_x=START_PITCH,
            real_time_factor=1.0,
            require_recorder='true',
            # Enough time for a restart on a busy machine.
            timeout=60.0,
            trajectory_file=tmp_path / 'trajectory.npz',
        )
        return nodes

    return start


def undisturbed(ticks):
    parameters = ParameterSet()
    parameters.set(PLANT, 'start_pitch_x', START_PITCH)
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
    nodes = start_graph(ticks * TICK_NS * 1e-9)
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


def test_drivers_may_be_killed_together_and_before_they_are_discovered(
    client, start_graph, start_node
):
    nodes = start_graph(60.0)
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
    nodes = start_graph(60.0)
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
    nodes = start_graph(5.0)
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


def test_a_node_without_a_run_stops_cleanly_on_a_signal(start_node, tmp_path):
    for name in NODES:
        node = start_node(name, **({'output': tmp_path / 'run.mcap'} if name == 'recorder' else {}))
        node.lines_until('started' if name != 'recorder' else 'records to')
        assert node.interrupt() == 0, name
        assert 'Traceback' not in node.output, name
