"""Comparison of recorded messages with those of a replay."""

import math
import struct

import pytest

from ballbot_ros.analysis.message_comparison import MessageComparator, first_difference
from ballbot_ros.recording.messages.conversions import encode_duty
from ballbot_ros.recording.messages.topics import LCD, MOTOR_DUTY
from ballbot_ros.recording.schemas import encoder, new_message

TICK = 4_000_000


def duty(stamp, x):
    return encode_duty(stamp, (x, 0))


def compared(recorded, replayed):
    """Compare the duties of plane x at ticks 0, 1, 2 ...; None means no message."""
    comparator = MessageComparator([MOTOR_DUTY])
    for take, values in ((comparator.add_recorded, recorded), (comparator.add_replayed, replayed)):
        for tick, value in enumerate(values):
            if value is not None:
                take(MOTOR_DUTY, [tick * TICK], [duty(tick * TICK, value)])
    return comparator


def test_equal_messages_are_identical_in_any_interleaving():
    comparator = compared([1, 2, 3], [1, 2, 3])
    assert comparator.first_difference(complete=True) is None
    assert comparator.compared() == 3


def test_the_first_difference_has_its_tick_field_and_values():
    difference = compared([1, 2, 3], [1, -2, 4]).first_difference(complete=True)
    assert difference.stamp_ns == TICK
    assert difference.topic == 'motor_duty'
    assert difference.what == 'vector.x: recorded 2.0, replayed -2.0'


def test_a_message_without_counterpart_counts_only_if_the_recording_is_complete():
    for recorded, replayed, what in (([1], [1, 2], 'not recorded'), ([1, 2], [1], 'not replayed')):
        comparator = compared(recorded, replayed)
        assert comparator.first_difference(complete=False) is None
        difference = comparator.first_difference(complete=True)
        assert difference.stamp_ns == TICK
        assert what in difference.what


def test_a_message_missing_in_the_middle_is_reported_as_missing():
    comparator = compared([1, None, 3, 4], [1, 2, 3, 4])
    difference = comparator.first_difference(complete=True)
    assert (difference.stamp_ns, difference.what) == (TICK, 'replayed but not recorded')
    difference = compared([1, 2, 3], [1, None, 3]).first_difference(complete=True)
    assert (difference.stamp_ns, difference.what) == (TICK, 'recorded but not replayed')


def test_within_a_tick_the_cause_comes_before_its_effect():
    text = new_message(LCD.type_name)
    comparator = MessageComparator([LCD, MOTOR_DUTY])
    for topic, one, other in (
        (MOTOR_DUTY, duty(0, 1), duty(0, 2)),
        (LCD, encoder(LCD.type_name)(text), None),
    ):
        comparator.add_recorded(topic, [0], [one])
        if other is None:
            text.data = 'other'
            other = encoder(LCD.type_name)(text)
        comparator.add_replayed(topic, [0], [other])
    assert comparator.first_difference(complete=True).topic == 'lcd'


@pytest.mark.parametrize(
    ('one', 'other', 'told'),
    [
        (0.0, -0.0, True),
        (math.nan, math.nan, False),
        (math.nan, struct.unpack('<d', struct.pack('<Q', 0x7FF8000000000001))[0], True),
        (1.0, math.nextafter(1.0, 2.0), True),
        (1.0, 1.0, False),
    ],
)
def test_numbers_are_compared_to_the_bit(one, other, told):
    recorded, replayed = (new_message('geometry_msgs/msg/Vector3') for _ in range(2))
    recorded.y, replayed.y = one, other
    assert bool(first_difference(recorded, replayed)) == told


def test_a_message_that_cannot_be_decoded_differs():
    broken = bytearray(duty(TICK, 2))
    broken[12 + 3] ^= 1  # the length of the frame's name
    comparator = compared([1], [1, 2])
    comparator.add_recorded(MOTOR_DUTY, [TICK], [bytes(broken)])
    difference = comparator.first_difference(complete=True)
    assert difference.stamp_ns == TICK
    assert difference.what.startswith(
        f'the recorded message is not a valid {MOTOR_DUTY.type_name}: Invalid string'
    )


def test_elements_of_arrays_are_shown_as_plain_numbers():
    recorded, replayed = (new_message('sensor_msgs/msg/Imu') for _ in range(2))
    recorded.orientation_covariance[5] = 0.5
    told = 'orientation_covariance[5]: recorded 0.5, replayed 0.0'
    assert first_difference(recorded, replayed) == told


def test_sequences_of_other_lengths_differ():
    recorded, replayed = (new_message('sensor_msgs/msg/JointState') for _ in range(2))
    recorded.name = ['a']
    assert first_difference(recorded, replayed) == 'name has 1 elements recorded, 0 replayed'
