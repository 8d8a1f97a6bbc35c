"""Nodes that are started by hand, and again in mid-run."""

import pytest
from graph import NODES, wait_for

from ballbot_ros.recording.reader import RecordingReader
from ballbot_ros.simulation.trajectory import load_trajectory

pytestmark = pytest.mark.graph

START_PITCH = 0.06981317007977318
OTHERS = [name for name in NODES if name not in ('plant_sim', 'recorder')]
DRIVERS = [name for name in OTHERS if name != 'controller']


@pytest.fixture
def start_graph(start_node, tmp_path):
    """Start every node by hand; the plant's summary comes from its trajectory file."""

    def start(duration, **plant):
        nodes = {name: start_node(name) for name in OTHERS}
        nodes['recorder'] = start_node('recorder', output=tmp_path / 'run.mcap')
        nodes['plant_sim'] = start_node(
            'plant_sim',
            duration=duration,
            start_pitch_x=START_PITCH,
            real_time_factor=0.0,
            require_recorder='true',
            trajectory_file=tmp_path / 'trajectory.npz',
            **plant,
        )
        return nodes

    return start


@pytest.fixture(scope='session')
def undisturbed_sha256():
    from ballbot_ros.parameters import PLANT, ParameterSet
    from ballbot_ros.simulation.closed_loop import ClosedLoop
    from ballbot_ros.simulation.trajectory import TrajectoryLog

    parameters = ParameterSet()
    parameters.set(PLANT, 'start_pitch_x', START_PITCH)
    loop, log = ClosedLoop(parameters), TrajectoryLog()
    for _ in range(1500):
        tick = loop.tick()
        log.add(tick.truth, *tick.outputs.duty)
    return log.duty_sha256


def is_under_way(tmp_path):
    path = tmp_path / 'run.mcap'
    return path.exists() and path.stat().st_size > 20_000


@pytest.mark.parametrize('victim', DRIVERS)
def test_a_restarted_driver_rejoins_and_changes_no_duty(
    start_graph, start_node, tmp_path, undisturbed_sha256, victim
):
    # Time enough for a restart on a busy machine.
    nodes = start_graph(6.0, timeout=20.0)
    wait_for(lambda: is_under_way(tmp_path), what='the run')
    nodes[victim].kill()
    start_node(victim)
    assert nodes['plant_sim'].finish() == 0, nodes['plant_sim'].output
    _, summary = load_trajectory(tmp_path / 'trajectory.npz')
    assert summary['outcome'] == 'completed'
    assert summary['duty_sha256'] == undisturbed_sha256
    nodes['recorder'].interrupt()
    with RecordingReader(tmp_path / 'run.mcap') as reader:
        assert reader.complete
        assert reader.topics()['/motor_duty'].message_count == 1500
        assert reader.topics()['/plant/imu'].message_count == 1500
        assert reader.topics()['/gyro'].message_count == 1500


def test_a_restarted_controller_fails_the_run_and_says_so(start_graph, start_node, tmp_path):
    nodes = start_graph(60.0, timeout=5.0)
    wait_for(lambda: is_under_way(tmp_path), what='the run')
    nodes['controller'].kill()
    second = start_node('controller')
    assert second.finish() == 1
    assert 'started in mid-run' in second.output
    assert nodes['plant_sim'].finish() == 1
    assert 'controller' in nodes['plant_sim'].output


def test_a_controller_may_be_told_to_begin_afresh(start_graph, start_node, tmp_path):
    nodes = start_graph(6.0, timeout=20.0)
    wait_for(lambda: is_under_way(tmp_path), what='the run')
    nodes['controller'].kill()
    controller = start_node('controller', rejoin='true')
    status = nodes['plant_sim'].finish()
    controller.interrupt()
    assert status == 0, nodes['plant_sim'].output + controller.output


def test_a_second_plant_is_refused_and_the_first_run_goes_on(
    start_graph, start_node, tmp_path, undisturbed_sha256
):
    nodes = start_graph(6.0, timeout=20.0)
    wait_for(lambda: is_under_way(tmp_path), what='the run')
    second = start_node('plant_sim', duration=6.0, real_time_factor=0.0)
    assert second.finish() == 2
    assert 'another plant' in second.output
    assert 'Traceback' not in second.output
    assert nodes['plant_sim'].finish() == 0, nodes['plant_sim'].output
    _, summary = load_trajectory(tmp_path / 'trajectory.npz')
    assert summary['duty_sha256'] == undisturbed_sha256


@pytest.mark.parametrize('name', NODES)
def test_a_node_stops_cleanly_on_a_signal(start_node, tmp_path, name):
    parameters = {'output': tmp_path / 'run.mcap'} if name == 'recorder' else {}
    node = start_node(name, **parameters)
    wait_for(lambda: _handles_sigint(node.process.pid), what='the start')
    assert node.interrupt() == 0
    assert 'Traceback' not in node.output


def _handles_sigint(pid):
    from pathlib import Path

    for line in Path(f'/proc/{pid}/status').read_text().splitlines():
        if line.startswith('SigCgt:'):
            return int(line.split()[1], 16) & (1 << 14)  # SIGTERM: Python itself catches SIGINT
    return False
