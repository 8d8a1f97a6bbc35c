"""Changes of parameters as messages."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ballbot_ros.recording.messages.raw import stamp_of
from ballbot_ros.recording.messages.run_reports import (
    decode_parameter_event,
    encode_parameter_event,
)
from ballbot_ros.recording.messages.topics import PARAMETER_EVENTS
from ballbot_ros.recording.schemas import encoder, new_message

numbers = st.floats(allow_nan=False)
values = st.dictionaries(
    st.text(st.characters(codec='utf-8', exclude_characters='\0')),
    st.one_of(
        st.booleans(),
        st.integers(-(2**63), 2**63 - 1),
        numbers,
        st.text(st.characters(codec='utf-8', exclude_characters='\0')),
        st.lists(numbers).map(tuple),
    ),
)


@given(st.integers(0, 2**31 * 10**9 - 1), values)
def test_every_value_is_read_as_it_was_written(stamp_ns, changed):
    data = encode_parameter_event(stamp_ns, changed)
    assert stamp_of(data) == stamp_ns
    found = decode_parameter_event(data)
    assert found == changed
    assert [type(each) for each in found.values()] == [type(each) for each in changed.values()]


def test_ros_reads_it():
    serialization = pytest.importorskip('rclpy.serialization')
    parameter = pytest.importorskip('rclpy.parameter')
    changed = {'k_f': (1.0, 2.0, 3.0, 4.0), 'k_i': -0.5, 'dst_thr': 30, 'on': True, 'mode': 'x'}
    data = encode_parameter_event(1_500_000_004, changed)
    event = serialization.deserialize_message(data, PARAMETER_EVENTS.message_class)
    assert (event.stamp.sec, event.stamp.nanosec, event.node) == (1, 500_000_004, 'controller')
    found = {
        each.name: parameter.parameter_value_to_python(each.value)
        for each in event.changed_parameters
    }
    assert {n: tuple(v) if n == 'k_f' else v for n, v in found.items()} == changed
    assert not event.new_parameters
    assert not event.deleted_parameters


def test_a_value_of_a_type_that_no_parameter_has_is_refused():
    message = new_message(PARAMETER_EVENTS.type_name)
    each = new_message('rcl_interfaces/msg/Parameter')
    each.name, each.value.type = 'k_i', 5
    message.changed_parameters.append(each)
    with pytest.raises(ValueError, match='k_i: type 5 of its value'):
        decode_parameter_event(encoder(PARAMETER_EVENTS.type_name)(message))
    with pytest.raises(ValueError, match='deserialize'):
        decode_parameter_event(b'\0\1\0\0')
