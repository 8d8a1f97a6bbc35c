"""The encoder against rosbags' and rclpy's, for every message type."""

import struct

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ballbot_ros.recording.encoding import encoder, new_message
from ballbot_ros.recording.errors import RecordingError
from ballbot_ros.recording.schemas import typestore


@pytest.mark.parametrize('type_name', sorted(typestore().fielddefs))
@settings(max_examples=20, deadline=None)
@given(chance=st.randoms(use_true_random=False))
def test_any_message_is_encoded_as_rosbags_does(type_name, chance, make_message, with_arrays):
    message = make_message(type_name, chance)
    expected = typestore().serialize_cdr(with_arrays(message, type_name), type_name)
    assert encoder(type_name)(message) == expected
    assert encoder(type_name)(with_arrays(message, type_name)) == expected


@settings(max_examples=200, deadline=None)
@given(data=st.data(), chance=st.randoms(use_true_random=False))
def test_rclpy_encodes_the_same_but_for_padding(
    data, chance, graph_types, make_message, to_rclpy, plain
):
    serialization = pytest.importorskip('rclpy.serialization')
    type_name = data.draw(st.sampled_from(graph_types))
    message = make_message(type_name, chance)
    theirs = serialization.serialize_message(to_rclpy(message, type_name))
    ours = encoder(type_name)(message)
    # Fast CDR leaves padding as it finds it, and reserves too much for empty sequences.
    decoded = typestore().deserialize_cdr(theirs[: len(ours)], type_name)
    assert encoder(type_name)(decoded) == ours
    decoded = serialization.deserialize_message(ours, type(to_rclpy(message, type_name)))
    assert plain(decoded, type_name) == plain(message, type_name)


@settings(max_examples=200, deadline=None)
@given(data=st.data(), chance=st.randoms(use_true_random=False))
def test_decoding_returns_the_message(data, chance, graph_types, make_message, plain):
    type_name = data.draw(st.sampled_from(graph_types))
    message = make_message(type_name, chance)
    decoded = typestore().deserialize_cdr(encoder(type_name)(message), type_name)
    assert plain(decoded, type_name) == plain(message, type_name)


def test_a_new_message_is_blank_and_shares_nothing():
    message = new_message('nav_msgs/msg/Odometry')
    assert message.child_frame_id == ''
    assert message.pose.covariance == [0.0] * 36
    assert message.pose.pose.orientation.w == 1.0
    assert message.pose.pose.orientation.x == 0.0
    message.pose.covariance[0] = 1.0
    message.header.frame_id = 'map'
    other = new_message('nav_msgs/msg/Odometry')
    assert other.pose.covariance[0] == 0.0
    assert other.header.frame_id == ''
    assert new_message('sensor_msgs/msg/JointState').position == []


def test_a_new_message_is_rclpys_new_message(graph_types, to_rclpy, plain):
    for type_name in graph_types:
        blank = new_message(type_name)
        theirs = type(to_rclpy(blank, type_name))()
        assert plain(blank, type_name) == plain(theirs, type_name)


def test_numbers_of_any_sequence_are_taken():
    message = new_message('sensor_msgs/msg/JointState')
    encodings = set()
    for kind in (list, tuple, np.array):
        message.position = kind([1, 2])
        encodings.add(encoder('sensor_msgs/msg/JointState')(message))
    assert len(encodings) == 1


@pytest.mark.parametrize(
    ('type_name', 'field', 'value'),
    [
        ('sensor_msgs/msg/Imu', 'orientation_covariance', [0.0] * 8),
        ('std_msgs/msg/UInt8MultiArray', 'data', [256]),
        ('std_msgs/msg/UInt8MultiArray', 'data', ['1']),
    ],
)
def test_what_does_not_fit_is_refused(type_name, field, value):
    message = new_message(type_name)
    setattr(message, field, value)
    with pytest.raises(struct.error):
        encoder(type_name)(message)


@pytest.mark.parametrize('function', [encoder, new_message])
def test_an_unknown_type_is_an_error(function):
    with pytest.raises(RecordingError, match=r"^'sensor_msgs/msg/Gyro' is not a message type"):
        function('sensor_msgs/msg/Gyro')
