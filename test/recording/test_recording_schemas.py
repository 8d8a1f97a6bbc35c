"""The definitions against the .msg and type description files that ROS installs."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from ballbot_ros.messages.topics import TOPICS
from ballbot_ros.recording.encoding import new_message
from ballbot_ros.recording.schemas import schema, typestore

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


def installed(type_name, suffix):
    path = definition_file(type_name, suffix)
    return path.read_text() if path else pytest.skip(f'{type_name} is not installed')


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


@pytest.mark.parametrize('type_name', TYPES)
def test_text_means_the_same_as_the_installed_definitions(type_name):
    root, *others = schema(type_name).text.split(f'{SEPARATOR}\nMSG: ')
    sections = {type_name: root}
    for other in others:
        name, text = other.split('\n', 1)
        sections[name.replace('/', '/msg/')] = text
    meanings = {}
    for name, text in sections.items():
        package = name.split('/')[0]
        meanings[name] = fields_and_constants(text, package)
        assert meanings[name] == fields_and_constants(installed(name, '.msg'), package)
    used = {
        kind.replace('/', '/msg/')
        for fields in meanings.values()
        for kind, *_ in fields
        if '/' in kind
    }
    assert sections.keys() == used | {type_name}


@pytest.mark.parametrize('type_name', TYPES)
def test_hash_is_the_installed_one(type_name):
    description = json.loads(installed(type_name, '.json'))
    hashes = {entry['type_name']: entry['hash_string'] for entry in description['type_hashes']}
    expected = '' if type_name == 'std_msgs/msg/Char' else hashes[type_name]
    assert schema(type_name).type_hash == expected


def test_defaults_of_all_types_are_the_installed_ones():
    for type_name in typestore().fielddefs:
        if path := definition_file(type_name, '.json'):
            message = new_message(type_name)
            description = json.loads(path.read_text())
            for field in description['type_description_msg']['type_description']['fields']:
                if default := field['default_value']:
                    assert str(getattr(message, field['name'])) in (default, f'{default}.0')


def test_nothing_here_imports_rclpy():
    modules = ('encoding', 'qos', 'reader', 'rosbag2', 'schemas', 'writer')
    names = ', '.join(f'ballbot_ros.recording.{module}' for module in modules)
    code = f"import sys, {names}; sys.exit('rclpy' in sys.modules)"
    assert subprocess.run([sys.executable, '-c', code], check=False).returncode == 0
