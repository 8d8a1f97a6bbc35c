"""The definitions against the .msg and type description files that ROS installs."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from ballbot_ros.recording.messages.topics import TOPICS
from ballbot_ros.recording.schemas import new_message, schema, typestore

TYPES = sorted(
    {topic.type_name for topic in TOPICS}
    | {
        'geometry_msgs/msg/TwistStamped',
        'rcl_interfaces/msg/Log',
        'rcl_interfaces/msg/ParameterEvent',
        'sensor_msgs/msg/NavSatFix',
        'sensor_msgs/msg/PointCloud2',
        'std_msgs/msg/Char',
        'visualization_msgs/msg/Marker',
    }
)
PREFIXES = [*os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep), sys.prefix]
SEPARATOR = '=' * 80


def definition_file(type_name, suffix):
    package, _, name = type_name.split('/')
    paths = [Path(prefix, 'share', package, 'msg', name + suffix) for prefix in PREFIXES]
    return next((path for path in paths if path.exists()), None)


@pytest.fixture
def installed_types():
    """Return the types whose files ROS has installed; skip if there are none."""
    types = [name for name in TYPES if definition_file(name, '.json')]
    return types or pytest.skip('no message definitions are installed')


def fields_and_constants(text, package):
    """Return type, name and constant value of each line, without defaults."""
    result = []
    for line in text.splitlines():
        match = re.match(r'\s*([\w/]+)(\[\S*\])?\s+(\w+)\s*(?:=\s*(.*?))?(\s.*)?$', line)
        if match and not line.lstrip().startswith('#'):
            kind, array, name, value = match.group(1, 2, 3, 4)
            if kind[0].isupper():
                kind = f'std_msgs/{kind}' if kind == 'Header' else f'{package}/{kind}'
            result.append((kind, array or '', name, value))
    return sorted(result)


def test_texts_mean_the_same_as_the_installed_definitions(installed_types):
    for type_name in installed_types:
        root, *others = schema(type_name).text.split(f'{SEPARATOR}\nMSG: ')
        sections = {type_name: root}
        for other in others:
            name, text = other.split('\n', 1)
            sections[name.replace('/', '/msg/')] = text
        used = {type_name}
        for name, text in sections.items():
            package = name.split('/')[0]
            meaning = fields_and_constants(text, package)
            file = definition_file(name, '.msg')
            assert meaning == fields_and_constants(file.read_text(), package), (type_name, name)
            used |= {kind.replace('/', '/msg/') for kind, *_ in meaning if '/' in kind}
        assert sections.keys() == used, type_name


def test_hashes_are_the_installed_ones(installed_types):
    expected = {}
    for type_name in installed_types:
        description = json.loads(definition_file(type_name, '.json').read_text())
        hashes = {entry['type_name']: entry['hash_string'] for entry in description['type_hashes']}
        expected[type_name] = '' if type_name == 'std_msgs/msg/Char' else hashes[type_name]
    assert {name: schema(name).type_hash for name in expected} == expected


def test_defaults_of_all_types_are_the_installed_ones():
    for type_name in typestore().fielddefs:
        if path := definition_file(type_name, '.json'):
            message = new_message(type_name)
            description = json.loads(path.read_text())
            for field in description['type_description_msg']['type_description']['fields']:
                if default := field['default_value']:
                    assert str(getattr(message, field['name'])) in (default, f'{default}.0')


def test_nothing_here_imports_rclpy():
    modules = ('reader', 'rosbag2', 'schemas', 'writer')
    names = ', '.join(f'ballbot_ros.recording.{module}' for module in modules)
    code = f"import sys, {names}; sys.exit('rclpy' in sys.modules)"
    assert subprocess.run([sys.executable, '-c', code], check=False).returncode == 0
