"""The shipped layouts only refer to topics and fields of recordings, and to transforms in them."""

import json
import math
import re
from pathlib import Path
from xml.etree import ElementTree

import pytest
import yaml
from graph import record
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory

from ballbot_ros.parameters import GamepadParameters
from ballbot_ros.recording.messages.topics import MARKERS, ROBOT_DESCRIPTION, TF, TF_STATIC
from ballbot_ros.viewer.robot import BALL, BODY, MAP

CONFIG = Path(__file__).resolve().parents[2] / 'config'


@pytest.fixture(scope='module')
def recorded(tmp_path_factory):
    """The last message of each topic of a recorded run with a map, as another reader decodes it."""
    folder = tmp_path_factory.mktemp('run')
    path, _ = record(folder, 'autonomous', '--set=plant_sim.duration=2.0')
    with path.open('rb') as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        return {channel.topic: message for _, channel, _, message in reader.iter_decoded_messages()}


@pytest.fixture(scope='module')
def frames(recorded):
    """The frames of the recorded transforms, each with its parent."""
    return {
        each.child_frame_id: each.header.frame_id
        for topic in (TF, TF_STATIC)
        for each in recorded[topic.name].transforms
    }


def value_at(path, recorded):
    """Return what a message path such as /motor_duty.vector.x or /state.position[1] refers to."""
    name, fields = re.fullmatch(r'([\w/]+)(.*)', path).groups()
    value = recorded[name]
    for field, index in re.findall(r'\.(\w+)|\[(\d+)\]', fields):
        value = getattr(value, field) if field else value[int(index)]
    return value


def test_foxglove_layout(recorded, frames):
    layout = json.loads((CONFIG / 'foxglove/ballbot.json').read_text(encoding='utf-8'))
    panels = layout['configById']

    def leaves(node):
        return [node] if isinstance(node, str) else leaves(node['first']) + leaves(node['second'])

    assert sorted(leaves(layout['layout'])) == sorted(panels)
    paths = [path['value'] for panel in panels.values() for path in panel.get('paths', ())]
    assert len(paths) > 8
    assert all(isinstance(value_at(path, recorded), float | str) for path in paths)
    assert isinstance(value_at(panels['RawMessages!lcd']['topicPath'], recorded), str)
    scene = panels['3D!robot']
    assert f'/{MARKERS.name}' in scene['topics']
    assert set(scene['topics']) <= recorded.keys()
    assert scene['followTf'] == BODY
    assert BODY in frames
    shown = [recorded[name] for name in scene['topics']]
    stamped = [each.header.frame_id for each in shown if hasattr(each, 'header')]
    assert set(stamped) <= {*frames, MAP}
    for name, layer in scene['layers'].items():
        assert layer['instanceId'] == name
    (robot,) = (each for each in scene['layers'].values() if each['layerId'] == 'foxglove.Urdf')
    assert (robot['sourceType'], robot['topic']) == ('topic', f'/{ROBOT_DESCRIPTION.name}')
    assert robot['visible']
    document = ElementTree.fromstring(recorded[robot['topic']].data)
    assert {link.get('name') for link in document.iter('link')} <= frames.keys()


def test_plotjuggler_layout(recorded):
    layout = ElementTree.parse(CONFIG / 'plotjuggler/ballbot.xml').getroot()
    curves = [curve.get('name') for curve in layout.iter('curve')]
    assert len(curves) > 8
    assert all(any(curve.startswith(f'{name}/') for name in recorded) for curve in curves)
    for splitter in layout.iter('DockSplitter'):
        assert int(splitter.get('count')) == len(splitter) == len(splitter.get('sizes').split(';'))


def test_rviz_config(recorded, frames):
    config = yaml.safe_load((CONFIG / 'rviz/ballbot.rviz').read_text(encoding='utf-8'))
    manager = config['Visualization Manager']
    displays = {each['Class'].removeprefix('rviz_default_plugins/'): each for each in (
        manager['Displays']
    )}  # fmt: skip
    assert {'MarkerArray', 'Map', 'Odometry', 'RobotModel', 'TF'} < displays.keys()
    sources = {
        kind: display.get('Topic') or display.get('Description Topic')
        for kind, display in displays.items()
    }
    topics = {kind: source['Value'] for kind, source in sources.items() if source}
    assert set(topics.values()) <= recorded.keys()
    assert topics['MarkerArray'] == f'/{MARKERS.name}'
    assert topics['RobotModel'] == f'/{ROBOT_DESCRIPTION.name}'
    # Topics that are published once must be kept for late subscribers.
    assert sources['Map']['Durability Policy'] == 'Transient Local'
    assert sources['RobotModel']['Durability Policy'] == 'Transient Local'
    # Recordings have the robot as URDF; without tf2_msgs, only the markers of the graph show it.
    assert manager['Global Options']['Fixed Frame'] == MAP
    assert displays['MarkerArray']['Enabled']
    assert displays['RobotModel']['Enabled']
    views = manager['Views']
    targets = {view['Target Frame'] for view in (views['Current'], *views['Saved'])}
    assert targets == {'<Fixed Frame>', BALL}
    assert BALL in frames


def test_robot_localization_parameters(recorded, frames):
    text = (CONFIG / 'robot_localization/ekf.yaml').read_text(encoding='utf-8')
    parameters = yaml.safe_load(text)['ekf_filter_node']['ros__parameters']
    expected = {'odom0': 'nav_msgs/Odometry', 'imu0': 'sensor_msgs/Imu'}
    for name, kind in expected.items():
        message = recorded[f'/{parameters[name]}']
        assert type(message).__name__ == kind.rpartition('/')[2]
        assert len(parameters[f'{name}_config']) == 15
    odometry = recorded[f'/{parameters["odom0"]}']
    assert odometry.header.frame_id == parameters['odom_frame'] == parameters['world_frame']
    assert odometry.child_frame_id == parameters['base_link_frame']
    assert frames[parameters['odom_frame']] == parameters['map_frame']
    assert recorded[f'/{parameters["imu0"]}'].header.frame_id in frames
    # The transforms have one publisher.
    assert parameters['publish_tf'] is False
    for covariance in (odometry.pose.covariance, odometry.twist.covariance):
        assert min(covariance[::7]) > 0.0


def test_teleop_twist_joy_parameters():
    text = (CONFIG / 'teleop_twist_joy/ballbot.yaml').read_text(encoding='utf-8')
    parameters = yaml.safe_load(text)['teleop_twist_joy_node']['ros__parameters']
    assert parameters['axis_linear'].keys() == parameters['scale_linear'].keys() == {'x', 'y'}
    stick = GamepadParameters()
    full = math.radians(stick.k_thetadot) * stick.ball_radius
    assert parameters['scale_linear']['x'] == pytest.approx(full, abs=0.005)
