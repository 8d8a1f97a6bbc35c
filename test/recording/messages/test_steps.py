"""The latest physics steps come back bit by bit, and ROS tools can read them."""

import math
import struct

import numpy as np
import pytest
from hypothesis import strategies as st
from laws import given, refusal
from parts import make_plant, run_plant

from ballbot_ros.recording.messages import devices
from ballbot_ros.recording.messages.conversions import (
    decode_ball_position,
    decode_body_rates,
    decode_motor_angles,
    encode_body,
    encode_motors,
    encode_odometry,
)
from ballbot_ros.recording.messages.devices import STEP_FIELDS, decode_steps, encode_steps
from ballbot_ros.recording.messages.raw import decoder, has_stamp, stamp_of
from ballbot_ros.recording.messages.topics import PLANT_STEPS
from ballbot_ros.recording.schemas import encoder
from ballbot_ros.robot.plant.ground_truth import STEP_VALUES, GroundTruth, state_before

STAMP = 1_234_000_000
states = st.tuples(*[st.floats()] * STEP_VALUES)


def truth_with(*steps):
    return GroundTruth(STAMP, *[(0.0, 0.0)] * 7, battery_voltage=8.0, steps=sum(steps, ()))


def bits(steps):
    # The sign of a NaN is the only bit that a negation may change.
    return struct.pack(f'<{len(steps)}d', *(each if each == each else math.nan for each in steps))


@given(st.lists(states, min_size=1, max_size=30))
def test_each_step_comes_back_with_the_same_bits(steps):
    data = encode_steps(truth_with(*steps))
    assert stamp_of(data) == STAMP
    for count in range(1, len(steps) + 1):
        assert bits(decode_steps(data, count)) == bits(sum(steps[-count:], ()))


def test_the_newest_step_is_what_the_other_topics_say():
    plant = make_plant(start_pitch_x=0.02, start_position_y=0.3)
    plant.keep_steps(5)
    for truth in run_plant(plant, [(40, -20)] * 10):
        newest = state_before(decode_steps(encode_steps(truth), 1), 0)
        assert newest.motor_angle == decode_motor_angles(encode_motors(truth))
        assert newest.psi_rate == decode_body_rates(encode_body(truth))
        assert newest.position == decode_ball_position(encode_odometry(truth, 0.026))


def test_tools_of_ros_read_it():
    serialization = pytest.importorskip('rclpy.serialization')
    step = 1.0, 2.0, 3.0, 4.0, 5.0, 6.0
    data = encode_steps(truth_with(step, step))
    message = serialization.deserialize_message(data, PLANT_STEPS.message_class)
    assert message.header.frame_id == 'map'
    assert (message.height, message.width, len(message.data)) == (1, 2, message.row_step)
    kind = np.dtype([(field.name, '<f8') for field in message.fields])
    assert [field.offset for field in message.fields] == [kind.fields[n][1] for n in STEP_FIELDS]
    assert {field.datatype for field in message.fields} == {message.fields[0].FLOAT64}
    rows = np.frombuffer(bytes(message.data), kind)
    assert rows[-1].tolist() == (1.0, 2.0, 3.0, 4.0, 5.0, -6.0)
    assert has_stamp(PLANT_STEPS.type_name)


def test_a_message_without_the_step_or_with_other_fields_is_refused():
    step = (0.0,) * STEP_VALUES
    data = encode_steps(truth_with(step, step))
    assert refusal(ValueError, decode_steps, data, 3) == 'it has no step that is 2 steps old'
    decode, encode = decoder(PLANT_STEPS.type_name), encoder(PLANT_STEPS.type_name)
    for name, value in (('fields', []), ('point_step', 47)):
        message = decode(data)
        setattr(message, name, value)
        assert 'the fields are not motor_x' in refusal(ValueError, decode_steps, encode(message), 1)
    assert refusal(ValueError, decode_steps, data[:40], 1)


def test_steps_of_another_encoder_are_read_too():
    data = encode_steps(truth_with((1.0, 2.0, 3.0, 4.0, 5.0, 6.0)))
    message = decoder(PLANT_STEPS.type_name)(data)
    message.header.frame_id = 'another'
    other = encoder(PLANT_STEPS.type_name)(message)
    assert decode_steps(other, 1) == decode_steps(data, 1)
    padding = data[:3] + b'\x01' + data[4:]
    assert decode_steps(padding, 1) == decode_steps(data, 1)


def test_bytes_that_the_middleware_appends_take_no_decoder(monkeypatch):
    data = encode_steps(truth_with((1.0, 2.0, 3.0, 4.0, 5.0, 6.0)))
    monkeypatch.setattr(devices, 'decoder', None)
    for appended in range(4):
        assert decode_steps(data + bytes(appended), 1) == (1.0, 2.0, 3.0, 4.0, 5.0, 6.0)
