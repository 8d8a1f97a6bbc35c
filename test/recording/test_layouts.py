"""The shipped layouts name what recordings have."""

import json
import re
from pathlib import Path
from xml.etree import ElementTree

import yaml

from ballbot_ros.messages.topics import TOPICS

CONFIG = Path(__file__).resolve().parents[2] / 'config'
NAMES = {'/' + topic.name.lstrip('/') for topic in TOPICS}


def test_foxglove_layout():
    layout = json.loads((CONFIG / 'foxglove/ballbot.json').read_text(encoding='utf-8'))
    panels = layout['configById']

    def leaves(node):
        return [node] if isinstance(node, str) else leaves(node['first']) + leaves(node['second'])

    assert sorted(leaves(layout['layout'])) == sorted(panels)
    paths = [path['value'] for panel in panels.values() for path in panel.get('paths', ())]
    assert len(paths) > 8
    assert {re.match(r'[\w/]+', path)[0] for path in paths} <= NAMES
    assert set(panels['3D!robot']['topics']) <= NAMES


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
    topics = [display['Topic']['Value'] for display in manager['Displays'] if 'Topic' in display]
    assert manager['Global Options']['Fixed Frame'] == 'map'
    assert len(topics) == 2
    assert set(topics) <= NAMES
