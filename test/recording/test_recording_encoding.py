"""Messages without a graph, compared with rclpy's and with their decoding."""

import struct

import numpy as np
import pytest
from hypothesis import strategies as st
from laws import given
from rosbags.serde import SerdeError

from ballbot_ros.errors import RecordingError
from ballbot_ros.recording.schemas import encoder, new_message, typestore


def decoded(message, type_name):
    return typestore().deserialize_cdr(encoder(type_name)(message), type_name)


@given(data=st.data(), chance=st.randoms(use_true_random=False))
def test_rclpy_encodes_the_same_but_for_padding(
    data, chance, graph_types, make_message, to_rclpy, plain
):
    serialization = pytest.importorskip('rclpy.serialization')
    type_name = data.draw(st.sampled_from(graph_types))
    message = make_message(type_name, chance)
    theirs = serialization.serialize_message(to_rclpy(message, type_name))
    ours = encoder(type_name)(message)
    # Compare after a second encoding, and without excess bytes: Fast CDR does not clear padding,
    # and reserves too much for empty sequences.
    read = typestore().deserialize_cdr(theirs[: len(ours)], type_name)
    assert encoder(type_name)(read) == ours
    read = serialization.deserialize_message(ours, type(to_rclpy(message, type_name)))
    assert plain(read, type_name) == plain(message, type_name)


@given(data=st.data(), chance=st.randoms(use_true_random=False))
def test_decoding_returns_the_message(data, chance, graph_types, make_message, plain):
    type_name = data.draw(st.sampled_from(graph_types))
    message = make_message(type_name, chance)
    assert plain(decoded(message, type_name), type_name) == plain(message, type_name)


def test_a_new_message_has_defaults_and_shares_nothing():
    message = new_message('nav_msgs/msg/Odometry')
    assert message.child_frame_id == ''
    assert list(message.pose.covariance) == [0.0] * 36
    assert message.pose.pose.orientation.w == 1.0
    assert message.pose.pose.orientation.x == 0.0
    message.pose.covariance[0] = 1.0
    message.header.frame_id = 'map'
    other = new_message('nav_msgs/msg/Odometry')
    assert other.pose.covariance[0] == 0.0
    assert other.header.frame_id == ''
    assert len(new_message('sensor_msgs/msg/JointState').position) == 0
    assert len(new_message('shape_msgs/msg/SolidPrimitive').dimensions) == 0  # up to 3


def test_a_new_message_is_rclpys_new_message(graph_types, to_rclpy, plain):
    for type_name in graph_types:
        blank = new_message(type_name)
        theirs = type(to_rclpy(blank, type_name))()
        assert plain(blank, type_name) == plain(theirs, type_name)


@pytest.mark.parametrize('kind', [list, tuple, np.array, lambda row: np.array(row, 'float32')])
def test_numbers_in_any_sequence_are_accepted(kind):
    message = new_message('sensor_msgs/msg/JointState')
    message.position = kind([1, 2])
    assert decoded(message, 'sensor_msgs/msg/JointState').position.tolist() == [1.0, 2.0]
    message = new_message('sensor_msgs/msg/Imu')
    message.orientation_covariance = kind([1] * 9)
    assert decoded(message, 'sensor_msgs/msg/Imu').orientation_covariance.tolist() == [1.0] * 9


@pytest.mark.parametrize('kind', [bytes, bytearray, list])
def test_bytes_are_accepted(kind):
    message = new_message('std_msgs/msg/UInt8MultiArray')
    message.data = kind(range(250, 256))
    assert bytes(decoded(message, 'std_msgs/msg/UInt8MultiArray').data) == bytes(range(250, 256))


def test_a_message_can_be_filled_and_encoded_again():
    joints = new_message('sensor_msgs/msg/JointState')
    for number in (1, 2):
        joints.position = [float(number), -1.0]
        assert decoded(joints, 'sensor_msgs/msg/JointState').position.tolist() == [number, -1.0]


@pytest.mark.parametrize(
    ('type_name', 'field', 'value', 'error'),
    [
        ('sensor_msgs/msg/Imu', 'orientation_covariance', [0.0] * 8, SerdeError),
        ('std_msgs/msg/UInt8MultiArray', 'data', [256], OverflowError),
        ('sensor_msgs/msg/Joy', 'buttons', ['on'], ValueError),
        ('sensor_msgs/msg/Range', 'radiation_type', 256, struct.error),
        ('std_msgs/msg/String', 'data', None, AttributeError),
    ],
)
def test_values_that_do_not_fit_are_refused(type_name, field, value, error):
    message = new_message(type_name)
    setattr(message, field, value)
    with pytest.raises(error):
        encoder(type_name)(message)


@pytest.mark.parametrize('function', [encoder, new_message])
def test_an_unknown_type_is_an_error(function):
    with pytest.raises(RecordingError, match=r"^'sensor_msgs/msg/Gyro' is not a message type"):
        function('sensor_msgs/msg/Gyro')
