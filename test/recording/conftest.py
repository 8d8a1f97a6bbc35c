"""Messages of every kind for the tests of recordings."""

import importlib
import math
import random
import struct

import numpy as np
import pytest
from rosbags.interfaces import Nodetype

from ballbot_ros.recording.schemas import encoder, new_message, typestore
from ballbot_ros.recording.writer import RecordingWriter

GRAPH_TYPES = (
    'rosgraph_msgs/msg/Clock',
    'sensor_msgs/msg/JointState',
    'sensor_msgs/msg/Imu',
    'sensor_msgs/msg/BatteryState',
    'sensor_msgs/msg/Range',
    'sensor_msgs/msg/Joy',
    'nav_msgs/msg/Odometry',
    'std_msgs/msg/Bool',
    'std_msgs/msg/String',
    'std_msgs/msg/UInt8MultiArray',
    'std_msgs/msg/Header',
    'geometry_msgs/msg/Vector3Stamped',
    'geometry_msgs/msg/WrenchStamped',
    'diagnostic_msgs/msg/DiagnosticArray',
)
INTEGERS = {
    'byte': (-128, 127),
    'char': (0, 255),
    **{f'int{bits}': (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1) for bits in (8, 16, 32, 64)},
    **{f'uint{bits}': (0, 2**bits - 1) for bits in (8, 16, 32, 64)},
}


def random_value(description, chance):
    kind, detail = description
    if kind == Nodetype.NAME:
        return random_message(detail, chance)
    if kind in (Nodetype.ARRAY, Nodetype.SEQUENCE):
        element, count = detail
        count = count if kind == Nodetype.ARRAY else chance.randint(0, min(count or 3, 3))
        values = [random_value(element, chance) for _ in range(count)]
        if element[0] == Nodetype.NAME or element[1][0] == 'string':
            return values
        return np.array(values, 'uint8' if element[1][0] == 'char' else element[1][0])
    name = detail[0]
    if name == 'string':
        return ''.join(chance.choice('aZ/ ö€') for _ in range(chance.randint(0, 9)))
    if name == 'bool':
        return chance.random() < 0.5
    if name in INTEGERS:
        return chance.randint(*INTEGERS[name])
    value = chance.choice((0.0, -0.0, math.inf, math.nan, chance.uniform(-1e3, 1e3)))
    return struct.unpack('f', struct.pack('f', value))[0] if name == 'float32' else value


def random_message(type_name, chance):
    message = new_message(type_name)
    for name, description in typestore().fielddefs[type_name][1]:
        setattr(message, name, random_value(description, chance))
    return message


def as_plain(value, description):
    """Reduce a value of any library to nested lists of numbers and strings."""
    kind, detail = description
    if kind == Nodetype.NAME:
        return [
            as_plain(getattr(value, name), field)
            for name, field in typestore().fielddefs[detail][1]
        ]
    if kind in (Nodetype.ARRAY, Nodetype.SEQUENCE):
        return [as_plain(item, detail[0]) for item in value]
    if detail[0] == 'byte':
        number = value[0] if isinstance(value, bytes) else int(value)
        return number & 0xFF
    if detail[0].startswith('float'):
        return struct.pack('d', math.nan if math.isnan(value) else value)
    return value if detail[0] == 'string' else int(value)


@pytest.fixture(scope='session')
def graph_types():
    """Return every type that a topic of the graph has."""
    return GRAPH_TYPES


@pytest.fixture(scope='session')
def make_message():
    """Return a function that fills a message of a type from a `random.Random`."""
    return random_message


@pytest.fixture(scope='session')
def plain():
    """Return a function that makes a message of any library comparable."""
    return lambda message, type_name: as_plain(message, (Nodetype.NAME, type_name))


@pytest.fixture(scope='session')
def to_rclpy():
    """Return a function that converts a message to rclpy's class; skip without rclpy."""
    pytest.importorskip('rclpy')

    def convert(value, description):
        kind, detail = description
        if kind == Nodetype.NAME:
            package, _, name = detail.split('/')
            message = getattr(importlib.import_module(f'{package}.msg'), name)()
            for field, field_description in typestore().fielddefs[detail][1]:
                setattr(message, field, convert(getattr(value, field), field_description))
            return message
        if kind in (Nodetype.ARRAY, Nodetype.SEQUENCE):
            return [convert(item, detail[0]) for item in value]
        if detail[0] == 'byte':
            return bytes([value & 0xFF])
        return value.item() if isinstance(value, np.generic) else value

    return lambda message, type_name: convert(message, (Nodetype.NAME, type_name))


@pytest.fixture(scope='session')
def sample():
    """Return the messages of a recording: topic, type, stamp, message, encoded message."""
    chance = random.Random(1)
    messages = []
    for number in range(20 * len(GRAPH_TYPES)):
        type_name = GRAPH_TYPES[number % len(GRAPH_TYPES)]
        message = random_message(type_name, chance)
        topic = '/' + type_name.rsplit('/', 1)[1].lower()
        stamp_ns = 10**9 + number * 4_000_000
        messages.append((topic, type_name, stamp_ns, message, encoder(type_name)(message)))
    return messages


@pytest.fixture(scope='session')
def record():
    """Return a function that writes `sample` and its attachments to a new file."""

    def write(path, messages, *, flush_every=100, **options):
        with RecordingWriter(path, **options) as writer:
            writer.add_metadata('run', {'seed': '1'})
            topics = {}
            for number, (topic, type_name, stamp_ns, _, data) in enumerate(messages):
                if topic not in topics:
                    topics[topic] = writer.add_topic(topic, type_name)
                writer.write(topics[topic], stamp_ns, data, number)
                if number % flush_every == flush_every - 1:
                    writer.flush()
            writer.add_attachment('scenario.yaml', 'application/yaml', b'name: stationary\n')
        return path

    return write


@pytest.fixture(scope='session')
def recording(record, sample, tmp_path_factory):
    """Return the path of a finished recording of `sample`."""
    return record(tmp_path_factory.mktemp('recording') / 'sample.mcap', sample)
