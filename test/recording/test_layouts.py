"""The shipped layouts only refer to topics and fields of recordings."""

import json
import re
from pathlib import Path
from xml.etree import ElementTree

import yaml

from ballbot_ros.messages.topics import MARKERS, ROBOT_DESCRIPTION, TOPICS
from ballbot_ros.viewer.robot import BALL, BODY
from ballbot_ros.viewer.transforms import MAP

CONFIG = Path(__file__).resolve().parents[2] / 'config'
NAMES = {'/' + topic.name.lstrip('/') for topic in TOPICS}
DRAWN = {f'/{topic.name}' for topic in (MARKERS, ROBOT_DESCRIPTION)}
"""Topics that robot_visualizer adds to those of a run or a player."""


def test_foxglove_layout():
    layout = json.loads((CONFIG / 'foxglove/ballbot.json').read_text(encoding='utf-8'))
    panels = layout['configById']

    def leaves(node):
        return [node] if isinstance(node, str) else leaves(node['first']) + leaves(node['second'])

    assert sorted(leaves(layout['layout'])) == sorted(panels)
    paths = [path['value'] for panel in panels.values() for path in panel.get('paths', ())]
    assert len(paths) > 8
    assert {re.match(r'[\w/]+', path)[0] for path in paths} <= NAMES
    scene = panels['3D!robot']
    assert f'/{MARKERS.name}' in scene['topics']
    assert set(scene['topics']) <= NAMES | DRAWN
    assert scene['followTf'] == BODY
    for name, layer in scene['layers'].items():
        assert layer['instanceId'] == name
    (robot,) = (each for each in scene['layers'].values() if each['layerId'] == 'foxglove.Urdf')
    assert (robot['sourceType'], robot['topic']) == ('topic', f'/{ROBOT_DESCRIPTION.name}')


def test_plotjuggler_layout():
    layout = ElementTree.parse(CONFIG / 'plotjuggler/ballbot.xml').getroot()
    curves = [curve.get('name') for curve in layout.iter('curve')]
    assert len(curves) > 8
    assert all(any(curve.startswith(f'{name}/') for name in NAMES) for curve in curves)
    for splitter in layout.iter('DockSplitter'):
        assert int(splitter.get('count')) == len(splitter) == len(splitter.get('sizes').split(';'))


def test_rviz_config():
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
    assert set(topics.values()) <= NAMES | DRAWN
    assert topics['MarkerArray'] == f'/{MARKERS.name}'
    assert topics['RobotModel'] == f'/{ROBOT_DESCRIPTION.name}'
    # Topics that are published once must be kept for late subscribers.
    assert sources['Map']['Durability Policy'] == 'Transient Local'
    assert sources['RobotModel']['Durability Policy'] == 'Transient Local'
    # Without transforms, only the markers show the robot.
    assert manager['Global Options']['Fixed Frame'] == MAP
    assert displays['MarkerArray']['Enabled']
    assert not displays['RobotModel']['Enabled']
    views = manager['Views']
    targets = {view['Target Frame'] for view in (views['Current'], *views['Saved'])}
    assert targets == {'<Fixed Frame>', BALL}
