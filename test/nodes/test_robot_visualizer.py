"""The robot for other tools: its description, also for late subscribers, and its drawing."""

import math
import subprocess
from importlib.util import find_spec
from itertools import pairwise
from types import SimpleNamespace
from xml.etree import ElementTree

import pytest
from graph import BALLBOT

pytest.importorskip('rclpy')

from ros_client import Client
from stubs import bare

from ballbot_ros.nodes import robot_visualizer
from ballbot_ros.nodes.base import BallbotNode
from ballbot_ros.nodes.robot_visualizer import RobotVisualizer
from ballbot_ros.parameters import VisualizerParameters
from ballbot_ros.recording.messages.conversions import stamp_ns
from ballbot_ros.recording.messages.tool_messages import DELETE_ALL
from ballbot_ros.recording.messages.topics import (
    MAP,
    MARKERS,
    PLANT_ODOM,
    ROBOT_DESCRIPTION,
    RUN,
    TF,
    TF_STATIC,
)
from ballbot_ros.recording.reader import RecordingReader
from ballbot_ros.viewer.snapshot import Snapshot

pytestmark = pytest.mark.graph


@pytest.fixture
def recording(tmp_path):
    """Three seconds near a wall, during which the ball rolls."""
    words = ['run', 'stationary', '--processes', 'none', '--output', tmp_path]
    settings = {'duration': 3.0, 'map': 'corridor', 'start_pitch_x': 0.05}
    options = [f'--set=plant_sim.{name}={value}' for name, value in settings.items()]
    subprocess.run([*BALLBOT, *words, *options], check=False, capture_output=True)
    return tmp_path / 'stationary.mcap'


def stamp(markers):
    return stamp_ns(next(marker for marker in markers if marker.ns == 'ball'))


def test_it_follows_a_player_that_restarts(recording, domain, start_node, tmp_path):
    visualizer = start_node('robot_visualizer', body_height='0.2')
    client = Client(domain)
    try:
        client.watch(ROBOT_DESCRIPTION)
        client.watch(MARKERS, depth=1000)

        def arrays():
            return [array.markers for array in client.seen.get(MARKERS.name, ())]

        # The description is published before there is anything to draw.
        client.spin_until(lambda: ROBOT_DESCRIPTION.name in client.newest)
        again = tmp_path / 'again.mcap'
        recorder = start_node('recorder', output=again)
        start_node('player', file=recording, loop=True, rate='2.0')

        def jumped_back():
            return any(later < earlier for earlier, later in pairwise(map(stamp, arrays())))

        def ball_positions():
            return {
                each.pose.position.x for array in arrays() for each in array if each.ns == 'ball'
            }

        # Wait for enough positions, too: on a busy machine only the end of the first pass may be
        # received.
        client.spin_until(lambda: len(ball_positions()) > 10 and jumped_back())
        assert recorder.interrupt() == 0
        assert visualizer.interrupt() == 0
    finally:
        client.close()
    (mass_centre,) = (
        link.find('inertial/origin').get('xyz')
        for link in ElementTree.fromstring(client.newest[ROBOT_DESCRIPTION.name].data).iter('link')
        if link.get('name') == 'base_link'
    )
    assert mass_centre == '0 0 0.2'
    assert arrays()[0][0].action == DELETE_ALL
    for before, after in pairwise(arrays()):
        if stamp(after) < stamp(before):
            assert after[0].action == DELETE_ALL
    drawn = [{(each.ns, each.id): each for each in array} for array in arrays()]
    assert any(('walls', 0) in found for found in drawn)
    assert any(len(found['trail', 0].points) > 1 for found in drawn if ('trail', 0) in found)
    has_tf = find_spec('tf2_msgs') is not None
    assert visualizer.output.count('tf2_msgs is not installed') == (not has_tf)
    # What the node publishes is recorded; the rest is derived.
    transforms = {topic.name for topic in (TF, TF_STATIC)}
    with RecordingReader(again) as reader:
        assert {f'/{MARKERS.name}', f'/{ROBOT_DESCRIPTION.name}', *transforms} <= set(
            reader.topics()
        )
        assert reader.derived() == (set() if has_tf else transforms)


class Newest(dict):
    """The newest messages, and what a poll returns."""

    def take(self):
        return self.polled


def test_the_drawing_begins_again_with_each_run_map_and_jump_back(monkeypatch):
    """Each row is a poll: changed topics, sim time, map, and the floors drawn from then on."""
    for name in ('map_grid', 'floor_map_of', 'stamp_ns'):
        monkeypatch.setattr(robot_visualizer, name, lambda message: message)
    begun, newest = [], Newest({PLANT_ODOM: 0})
    node = bare(
        RobotVisualizer,
        _frames=SimpleNamespace(at=lambda position, psi: {}),
        _markers=SimpleNamespace(begin=begun.append, follow=lambda snapshot: None),
        _markers_output=SimpleNamespace(has_subscribers=False),
        _newest=newest,
        _derive=lambda: None,
        _time=-math.inf,
        _whole_at=-math.inf,
        apply_parameters=lambda: None,
        count_sample=lambda now_ns: None,
    )
    for changed, sim_time, floor, expected in (
        ({RUN}, 1.0, None, [None]),
        ({MAP}, 1.0, 'track', ['track']),
        (set(), 2.0, 'track', []),
        (set(), 1.5, 'track', ['track']),  # a player has jumped back
        ({RUN}, 3.0, None, [None]),
        (set(), 3.1, None, []),
        ({RUN, MAP}, 4.0, 'corridor', ['corridor']),
    ):
        begun.clear()
        newest[MAP] = floor
        newest.polled = Snapshot(sim_time, (0.0, 0.0), (0.0, 0.0)), changed
        node._update()
        assert begun == expected, (changed, sim_time)


def test_everything_is_drawn_once_a_second_and_changes_at_once(monkeypatch):
    """Each row is a poll: wall time, changed topics, and whether the markers are all of them."""
    monkeypatch.setattr(robot_visualizer, 'poses_in_map', lambda frames: frames)
    drawn, newest = [], Newest()
    snapshot = SimpleNamespace(time=1.0, position=(0.0, 0.0), psi=(0.0, 0.0))
    node = bare(
        RobotVisualizer,
        _frames=SimpleNamespace(at=lambda position, psi: {}),
        _markers=SimpleNamespace(at=lambda snapshot, poses, *, whole: drawn.append(whole) or []),
        _markers_output=SimpleNamespace(has_subscribers=True, publish=lambda message: None),
        _newest=newest,
        _derive=lambda: None,
        _time=1.0,
        _whole_at=-math.inf,
    )
    for now_s, changed, expected in (
        (10.0, {PLANT_ODOM}, [True]),
        (10.5, {PLANT_ODOM}, [False]),
        (10.6, set(), []),
        (11.0, set(), [True]),
        (11.9, set(), []),
    ):
        drawn.clear()
        clock = SimpleNamespace(monotonic=lambda now_s=now_s: now_s)
        monkeypatch.setattr(robot_visualizer, 'time', clock)
        newest.polled = snapshot, changed
        node._update()
        assert drawn == expected, now_s


def test_another_shape_is_described(monkeypatch):
    described = []
    node = bare(
        RobotVisualizer,
        _describe=lambda: described.append(node.parameters),
        parameters=VisualizerParameters(),
    )
    monkeypatch.setattr(BallbotNode, 'apply_parameters', lambda node: vars(node).update(requested))
    taller = VisualizerParameters(body_height=0.3)
    for parameters in (VisualizerParameters(), taller, taller):
        requested = {'parameters': parameters}
        node.apply_parameters()
    assert described == [taller]
