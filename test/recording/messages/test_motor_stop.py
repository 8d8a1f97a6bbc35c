"""The motor_duty that answers no tick."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ballbot_ros.recording.messages.conversions import encode_duty, encode_stop, is_stop
from ballbot_ros.recording.messages.raw import decoder
from ballbot_ros.recording.messages.topics import MOTOR_DUTY

stamps = st.integers(0, 2**31 * 10**9 - 1)
duties = st.tuples(st.integers(-100, 100), st.integers(-100, 100))


@given(stamps, duties)
def test_a_stop_is_distinguished_from_every_answer(stamp, duty):
    assert not is_stop(encode_duty(stamp, duty))
    assert is_stop(encode_stop(stamp))
    message = decoder(MOTOR_DUTY.type_name)(encode_stop(stamp))
    assert (message.vector.x, message.vector.y) == (0.0, 0.0)


@given(st.binary(max_size=60))
def test_malformed_bytes_are_not_a_stop(data):
    assert not is_stop(data)


def test_a_stop_serialised_by_ros_is_recognised():
    serialization = pytest.importorskip('rclpy.serialization')
    for data, expected in ((encode_stop(1), True), (encode_duty(1, (0, 0)), False)):
        message = serialization.deserialize_message(data, MOTOR_DUTY.message_class)
        assert is_stop(serialization.serialize_message(message)) is expected
