"""The motor_duty that answers no tick."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ballbot_ros.messages.conversions import fill_duty
from ballbot_ros.messages.motor_stop import fill_stop, is_stop
from ballbot_ros.messages.topics import MOTOR_DUTY
from ballbot_ros.recording.encoding import encoder, new_message

encode = encoder(MOTOR_DUTY.type_name)
stamps = st.integers(0, 2**31 * 10**9 - 1)
duties = st.tuples(st.integers(-100, 100), st.integers(-100, 100))


@given(stamps, duties)
def test_a_stop_is_distinguished_from_every_answer(stamp, duty):
    message = new_message(MOTOR_DUTY.type_name)
    fill_duty(message, stamp, duty)
    assert not is_stop(encode(message))
    fill_stop(message, stamp)
    assert is_stop(encode(message))
    assert (message.vector.x, message.vector.y) == (0.0, 0.0)


@given(st.binary(max_size=60))
def test_malformed_bytes_are_not_a_stop(data):
    assert not is_stop(data)


def test_a_stop_serialised_by_ros_is_recognised():
    serialization = pytest.importorskip('rclpy.serialization')
    message = MOTOR_DUTY.message_class()
    fill_stop(message, 1)
    assert is_stop(serialization.serialize_message(message))
    fill_duty(message, 1, (0, 0))
    assert not is_stop(serialization.serialize_message(message))
