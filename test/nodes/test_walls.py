"""The world in the graph: map, sonar and wall hits are the same however the run is made."""

import math

import pytest
import yaml
from graph import Run, free_domain
from maps import save, with_walls

from ballbot_ros.brick.sonar import Sonar
from ballbot_ros.messages.conversions import ball_position
from ballbot_ros.parameters import SONAR
from ballbot_ros.recording.reader import RecordingReader
from ballbot_ros.scenario.library import load_profile
from ballbot_ros.world.exports import occupancy_grid
from ballbot_ros.world.library import load_map
from ballbot_ros.world.sonar_beam import SonarBeam

pytestmark = pytest.mark.graph

WAYS = ['separate', 'one', 'none']
# A robot that leans forward too far to be caught drives into the wall before it, and the noisy
# devices of the hardware profile see it.
SCENARIO = """\
purpose: runs into a wall
duration: 4.0
profile: hardware
start: {{pitch_x_deg: 3.0}}
pushes: [{{time: 1.2, duration: 0.1, force: 2.0, direction: forward}}]
parameters: {{plant_sim: {{map: {map}, on_wall_hit: {on_wall_hit}}}}}
"""


def made_runs(tmp_path_factory, on_wall_hit):
    folder = tmp_path_factory.mktemp(on_wall_hit)
    image = save(with_walls(100, 100, (0, 100, 64, 66)), folder / 'wall.bmp')
    scenario = folder / 'wall.yaml'
    scenario.write_text(SCENARIO.format(map=image, on_wall_hit=on_wall_hit))
    runs = {}
    for processes in WAYS:
        with free_domain() as domain:
            run = Run(domain, scenario, '--processes', processes, '--json',
                      '--output', folder / processes)  # fmt: skip
            run.status = run.finish()
            runs[processes] = run
    return runs


@pytest.fixture(scope='module')
def stopped(tmp_path_factory):
    return made_runs(tmp_path_factory, 'stop')


@pytest.fixture(scope='module')
def reported(tmp_path_factory):
    return made_runs(tmp_path_factory, 'report')


def recorded(run, topic):
    with RecordingReader(run.result['recording']) as reader:
        return [(stamp, message) for _, stamp, message in reader.messages([topic])]


@pytest.mark.parametrize('processes', WAYS)
def test_a_hit_ends_the_run_alike_in_every_way(stopped, processes):
    run, expected = stopped[processes], stopped['none'].result
    assert run.status == 1
    assert 'Traceback' not in run.stderr
    assert run.result['outcome'] == 'failed'
    assert run.result['reason'].startswith('wall hit at sim time ')
    assert run.result['reason'].endswith('front left, front middle, front right')
    assert run.stderr.count(run.result['reason']) == 1
    for key in ('reason', 'ticks', 'duty_sha256', 'metrics'):
        assert run.result[key] == expected[key], key


@pytest.mark.parametrize('processes', WAYS)
def test_the_recording_has_the_hit_and_the_last_truth(stopped, processes):
    run = stopped[processes]
    end = 1_000_000_000 + run.result['ticks'] * 4_000_000
    assert end % 20_000_000 == 0
    hits = [message.data for _, message in recorded(run, '/wall_hit')]
    assert hits == [False, True]
    odometry = recorded(run, '/plant/odom')
    assert odometry[-1][0] == end
    assert repr(odometry) == repr(recorded(stopped['none'], '/plant/odom'))


@pytest.mark.parametrize('processes', ['separate', 'one'])
def test_the_diagnostics_have_the_error(stopped, processes):
    run = stopped[processes]
    errors = {
        status.message
        for _, message in recorded(run, '/diagnostics')
        for status in message.status
        if status.level in (2, b'\x02')
    }
    assert errors == {run.result['reason']}


@pytest.mark.parametrize('processes', WAYS)
def test_a_hit_that_is_reported_lets_the_run_go_on(reported, processes):
    run, expected = reported[processes], reported['none'].result
    assert run.status == 0, run.stderr
    assert run.result['ticks'] == 1000
    assert run.result['duty_sha256'] == expected['duty_sha256']
    hits = [message.data for _, message in recorded(run, '/wall_hit')]
    assert hits[:2] == [False, True]
    assert hits == [message.data for _, message in recorded(reported['none'], '/wall_hit')]
    if processes != 'none':
        assert run.stderr.count('wall hit at sim time') == hits.count(True)


@pytest.mark.parametrize('processes', WAYS)
def test_the_map_is_recorded_once_as_it_is(stopped, processes):
    ((stamp, message),) = recorded(stopped[processes], '/map')
    with RecordingReader(stopped[processes].result['recording']) as reader:
        path = reader.attachments()['map.bmp']
    assert stamp == 1_000_000_000
    assert message.header.frame_id == 'map'
    assert (message.header.stamp.sec, message.info.map_load_time.sec) == (1, 1)
    assert (message.info.width, message.info.height) == (100, 100)
    assert message.info.resolution == pytest.approx(0.01)
    corner = message.info.origin
    assert (corner.position.x, corner.position.y, corner.orientation.w) == (-0.5, -0.5, 1.0)
    grid = occupancy_grid(with_walls(100, 100, (0, 100, 64, 66)))
    assert list(message.data) == grid.cells.ravel().tolist()
    assert path.media_type == 'image/bmp'


@pytest.mark.parametrize('processes', WAYS)
def test_the_recording_tells_nothing_of_this_machine(stopped, processes, tmp_path):
    with RecordingReader(stopped[processes].result['recording']) as reader:
        attached = reader.attachments()
    parameters = yaml.safe_load(attached['parameters.yaml'].data)
    for node in ('plant_sim', 'sonar_driver'):
        assert parameters[f'/**/{node}']['ros__parameters']['map'] == 'map.bmp'
    (tmp_path / 'again.bmp').write_bytes(attached['map.bmp'].data)
    assert load_map(f'{tmp_path}/again.bmp').walls.sum() == 200


@pytest.mark.parametrize('processes', WAYS)
def test_the_sonar_reads_what_the_map_says(stopped, processes, tmp_path):
    run = stopped[processes]
    profile = load_profile('hardware')
    image = save(with_walls(100, 100, (0, 100, 64, 66)), tmp_path / 'wall.png')
    profile.set(SONAR, 'map', str(image))
    device, beam = Sonar(profile.values(SONAR)), SonarBeam(profile.values(SONAR))
    positions = {stamp: ball_position(m) for stamp, m in recorded(run, '/plant/odom')}
    readings = recorded(run, '/sonar')
    assert len(readings) >= run.result['ticks'] // 5
    for stamp, message in readings:
        cm = device.read(beam.distance_m(positions[stamp]), stamp)
        expected = math.inf if cm == 255 else cm / 100.0
        assert message.range == pytest.approx(expected, abs=1e-6)
    assert len({message.range for _, message in readings}) > 3


@pytest.mark.parametrize(
    ('settings', 'hint'),
    [
        ({'start_position_x': 2.0}, 'off the map'),
        ({'start_position_x': 0.9}, 'in a wall: front left'),
        ({'map': 'nowhere'}, 'shipped: corridor, track'),
    ],
)
def test_a_plant_that_can_not_start_there_says_so(start_node, settings, hint):
    node = start_node('plant_sim', **{'map': 'track', **settings})
    assert node.finish() == 2
    assert hint in node.output
    assert 'Traceback' not in node.output
    assert len([line for line in node.output.splitlines() if 'error' in line]) == 1


def test_a_sonar_with_an_even_cone_says_so(start_node):
    node = start_node('sonar_driver', cone_rays=4)
    assert node.finish() == 2
    assert 'cone_rays: 4 is even' in node.output
