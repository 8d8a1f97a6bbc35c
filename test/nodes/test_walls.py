"""The world in the graph: the same map, sonar and wall hits in all arrangements of processes."""

import contextlib
import json
import math
from types import SimpleNamespace

import pytest
import yaml
from graph import Run, call, free_domain
from maps import save, with_walls

from ballbot_ros.analysis.run_data import read_run
from ballbot_ros.engine.devices import SONAR_DEVICE
from ballbot_ros.engine.scenario.reader import load_profile
from ballbot_ros.parameters import SONAR, SonarParameters
from ballbot_ros.recording.messages.conversions import odometry_position
from ballbot_ros.recording.messages.topics import MOTOR_DUTY
from ballbot_ros.recording.reader import RecordingReader
from ballbot_ros.robot.world.floor_map import load_map, occupancy_grid

pytestmark = pytest.mark.graph

# A robot that leans forward too far to recover drives into the wall in front of it, and the noisy
# devices of the hardware profile measure it.
SCENARIO = """\
purpose: runs into a wall
duration: 2.2
profile: hardware
start: {{pitch_x_deg: 3.0}}
pushes: [{{time: 1.2, duration: 0.1, force: 2.0, direction: forward}}]
parameters: {{plant_sim: {{map: {map}, on_wall_hit: {on_wall_hit}}}}}
"""


@pytest.fixture
def make_runs(tmp_path):
    """Run into the wall in several arrangements of processes at once; return the runs by these.

    The run without nodes, which needs no process of its own, is always among them.
    """
    with contextlib.ExitStack() as stack:

        def make(on_wall_hit, ways):
            image = save(with_walls(100, 100, (0, 100, 64, 66)), tmp_path / 'wall.bmp')
            scenario = tmp_path / 'wall.yaml'
            scenario.write_text(SCENARIO.format(map=image, on_wall_hit=on_wall_hit))
            runs = {}
            for processes in ways:
                run = Run(stack.enter_context(free_domain()), scenario, '--processes', processes,
                          '--json', '--output', tmp_path / processes)  # fmt: skip
                stack.callback(run.kill)
                runs[processes] = run
            done = call(
                'run', scenario, '--processes=none', '--json', '--output', tmp_path / 'none'
            )
            for run in runs.values():
                run.status = run.finish()
            without_nodes = SimpleNamespace(
                status=done.returncode, stderr=done.stderr, result=json.loads(done.stdout)
            )
            return runs | {'none': without_nodes}

        yield make


def recorded(run, topic):
    with RecordingReader(run.result['recording']) as reader:
        return [(stamp, message) for _, stamp, message in reader.messages([topic])]


def hits(run):
    return [message.data for _, message in recorded(run, '/wall_hit')]


def test_a_hit_ends_the_run_in_the_same_way_with_and_without_the_graph(
    make_runs, command, tmp_path
):
    runs = make_runs('stop', ['separate', 'one'])
    expected = runs['none']
    for processes, run in runs.items():
        assert run.status == 1, processes
        assert 'Traceback' not in run.stderr, processes
        assert run.result['outcome'] == 'failed', processes
        assert run.result['reason'].startswith('wall hit at sim time '), processes
        assert run.result['reason'].endswith('front left, front middle, front right'), processes
        assert run.stderr.count(run.result['reason']) == 1, processes
        for key in ('reason', 'ticks', 'duty_sha256', 'metrics'):
            assert run.result[key] == expected.result[key], (processes, key)
        # The recording has the hit and the plant's last state.
        end = 1_000_000_000 + run.result['ticks'] * 4_000_000
        assert end % 20_000_000 == 0, processes
        assert hits(run) == [False, True], processes
        odometry = recorded(run, '/plant/odom')
        assert odometry[-1][0] == end, processes
        assert repr(odometry) == repr(recorded(expected, '/plant/odom')), processes
        # The motors are off from the next tick on; in the graph the controller may have answered
        # the last tick.
        last_ns, last = recorded(run, '/motor_duty')[-1]
        assert (last.header.frame_id, last.vector.x, last.vector.y) == ('stop', 0.0, 0.0), processes
        assert last_ns == end + 4_000_000, processes
        if processes != 'none':
            assert reported_errors(run) == {run.result['reason']}, processes
        the_map_is_recorded_once_as_it_is(run, processes)
        the_recording_reveals_nothing_about_this_machine(run, tmp_path, processes)
        the_sonar_reads_the_distances_of_the_map(run, tmp_path, processes)
        # A motor stop, which answers no tick, is neither reported nor replayed.
        data = read_run(run.result['recording'])
        duty = data.series[MOTOR_DUTY]
        assert duty.stamps[-1] <= end, processes
        assert len(data.trajectory.time) - run.result['ticks'] in (0, 1), processes
        assert command('replay', run.result['recording'])[0] == 0, processes


def reported_errors(run):
    return {
        status.message
        for _, message in recorded(run, '/diagnostics')
        for status in message.status
        if status.level in (2, b'\x02')
    }


def the_map_is_recorded_once_as_it_is(run, processes):
    ((stamp, message),) = recorded(run, '/map')
    with RecordingReader(run.result['recording']) as reader:
        path = reader.attachments()['map.bmp']
    assert stamp == 1_000_000_000, processes
    assert message.header.frame_id == 'map', processes
    assert (message.header.stamp.sec, message.info.map_load_time.sec) == (1, 1), processes
    assert (message.info.width, message.info.height) == (100, 100), processes
    assert message.info.resolution == pytest.approx(0.01), processes
    corner = message.info.origin
    assert (corner.position.x, corner.position.y, corner.orientation.w) == (-0.5, -0.5, 1.0)
    grid = occupancy_grid(with_walls(100, 100, (0, 100, 64, 66)))
    assert list(message.data) == grid.cells.ravel().tolist(), processes
    assert path.media_type == 'image/bmp', processes


def the_recording_reveals_nothing_about_this_machine(run, tmp_path, processes):
    with RecordingReader(run.result['recording']) as reader:
        attached = reader.attachments()
    parameters = yaml.safe_load(attached['parameters.yaml'].data)
    for node in ('plant_sim', 'sonar_driver'):
        assert parameters[f'/**/{node}']['ros__parameters']['map'] == 'map.bmp', processes
    (tmp_path / 'again.bmp').write_bytes(attached['map.bmp'].data)
    assert load_map(f'{tmp_path}/again.bmp').walls.sum() == 200, processes


def the_sonar_reads_the_distances_of_the_map(run, tmp_path, processes):
    profile = load_profile('hardware')
    image = save(with_walls(100, 100, (0, 100, 64, 66)), tmp_path / 'wall.png')
    profile.set(SONAR, 'map', str(image))
    read = SONAR_DEVICE.make(profile.of(SonarParameters))
    positions = {stamp: odometry_position(m) for stamp, m in recorded(run, '/plant/odom')}
    readings = recorded(run, '/sonar')
    assert len(readings) >= run.result['ticks'] // 5, processes
    for stamp, message in readings:
        cm = read(positions[stamp], stamp)
        expected = math.inf if cm == 255 else cm / 100.0
        assert message.range == pytest.approx(expected, abs=1e-6), (processes, stamp)
    assert len({message.range for _, message in readings}) > 3, processes


def test_with_on_wall_hit_report_the_run_continues(make_runs):
    runs = make_runs('report', ['one'])
    for processes, run in runs.items():
        assert run.status == 0, (processes, run.stderr)
        assert run.result['ticks'] == 550, processes
        assert run.result['duty_sha256'] == runs['none'].result['duty_sha256'], processes
        assert hits(run) == [False, True, False], processes
        assert hits(run) == hits(runs['none']), processes
        if processes != 'none':
            assert run.stderr.count('wall hit at sim time') == hits(run).count(True), processes


def test_a_blocked_start_position_is_reported(start_node):
    node = start_node('plant_sim', map='track', start_position_x=0.9)
    assert node.finish() == 2
    assert 'in a wall: front left' in node.output
    assert 'Traceback' not in node.output
    assert len([line for line in node.output.splitlines() if 'error' in line]) == 1
