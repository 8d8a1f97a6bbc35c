"""The fixed layouts, compared with the general encoders and decoders of rosbags and rclpy."""

from operator import attrgetter

import numpy as np
import pytest
from hypothesis import strategies as st
from laws import given

from ballbot_ros.recording.messages import conversions, devices
from ballbot_ros.recording.messages.raw import MessageLayout, decoder, elements, stamp_of
from ballbot_ros.recording.messages.topics import TOPICS, message_class
from ballbot_ros.recording.schemas import encoder, new_message

JOINTS = 'sensor_msgs/msg/JointState'
LAYOUTS = [
    each
    for module in (conversions, devices)
    for each in vars(module).values()
    if isinstance(each, MessageLayout)
] + [conversions._sticks('scenario')]
stamps = st.integers(0, 2**31 * 10**9 - 1)
numbers = st.lists(st.floats(width=32), min_size=12, max_size=12)


def values_of(message, layout):
    """Read the numbers of a message one by one, from their names."""
    found = []
    for name in layout._names:
        path, _, index = name.removesuffix(']').partition('[')
        value = attrgetter(path)(message)
        found.append(value[int(index)] if index else value)
    return found


def test_every_periodic_topic_has_a_layout():
    types = {layout.type_name for layout in LAYOUTS}
    assert {topic.type_name for topic in TOPICS if topic.period_ns} <= types


@given(stamp=stamps, values=numbers)
def test_an_encoded_message_is_the_one_that_rosbags_encodes(stamp, values):
    for layout in LAYOUTS:
        wanted = values[: len(layout._names)]
        data = layout.encode(stamp, *wanted)
        message = decoder(layout.type_name)(data)
        assert encoder(layout.type_name)(message) == data
        assert stamp_of(data) == stamp
        np.testing.assert_array_equal(values_of(message, layout), wanted)
        np.testing.assert_array_equal(layout.decode(data), wanted)


@given(stamp=stamps, values=numbers)
def test_rclpy_reads_and_sends_the_same_numbers(stamp, values):
    serialization = pytest.importorskip('rclpy.serialization')
    for layout in LAYOUTS:
        wanted = values[: len(layout._names)]
        kind = message_class(layout.type_name)
        data = layout.encode(stamp, *wanted)
        message = serialization.deserialize_message(data, kind)
        np.testing.assert_array_equal(values_of(message, layout), wanted)
        # Fast CDR does not clear padding, and reserves too much for empty sequences.
        theirs = serialization.serialize_message(message)[: len(data)]
        np.testing.assert_array_equal(layout.decode(theirs), wanted)


def joints(**fields):
    message = new_message(JOINTS)
    for name, value in fields.items():
        setattr(message, name, value)
    return encoder(JOINTS)(message)


LAYOUT = MessageLayout(JOINTS, elements('position', 2), {'name': ['a', 'b'], 'position': [0.0] * 2})


@pytest.mark.parametrize(
    'fields',
    [
        {'name': ['a', 'c']},
        {'name': ['somebody', 'else']},
        {'position': [1.0, 2.0, 3.0]},
        {'velocity': [3.0]},
        {'name': []},
    ],
)
def test_messages_of_another_layout_are_read_by_the_general_decoder(fields):
    data = joints(**{'name': ['a', 'b'], 'position': [1.0, 2.0]} | fields)
    assert LAYOUT.decode(data) == (1.0, 2.0)


def test_a_message_with_too_few_numbers_is_refused():
    with pytest.raises(IndexError):
        LAYOUT.decode(joints(name=['a', 'b'], position=[1.0]))


@given(cut=st.integers(0, 60), change=st.integers(0, 255))
def test_malformed_bytes_are_refused_or_read_like_the_general_decoder(cut, change):
    data = bytearray(LAYOUT.encode(5, 1.0, 2.0))
    data[cut] = change
    for damaged in (bytes(data), bytes(data[:cut])):
        try:
            message = decoder(JOINTS)(damaged)
            expected = tuple(message.position[:2]) if len(message.position) > 1 else IndexError
        except ValueError:
            expected = ValueError
        if isinstance(expected, tuple):
            np.testing.assert_array_equal(LAYOUT.decode(damaged), expected)
        else:
            with pytest.raises(expected):
                LAYOUT.decode(damaged)


def test_an_identity_is_required_in_every_layout():
    layout = MessageLayout(
        JOINTS, elements('position', 1), {'name': ['a'], 'position': [0.0]}, identity='name'
    )
    assert layout.decode(joints(name=['a'], position=[7.0, 8.0])) == (7.0,)
    with pytest.raises(ValueError, match=r"name: \['b'\], not \['a'\]"):
        layout.decode(joints(name=['b'], position=[7.0]))
