"""The messages of the devices: the plant's true state (the truth), and the samples of it.

The functions that encode and decode messages are like those of
:mod:`ballbot_ros.recording.messages.conversions`.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, lru_cache, partial
from typing import Any, Generic, NamedTuple, TypeAlias

from ballbot_ros.engine.devices import ENCODER_DEVICE, GYRO_DEVICE, SONAR_DEVICE, Device, P, Reading
from ballbot_ros.recording.messages import topics
from ballbot_ros.recording.messages.conversions import (
    MOTOR_NAMES,
    NOT_PROVIDED,
    decode_ball_position,
    decode_battery_mv,
    decode_body_rates,
    decode_motor_angles,
    decode_sticks,
)
from ballbot_ros.recording.messages.raw import MessageLayout, decoder, elements, with_stamp
from ballbot_ros.recording.messages.topics import Topic
from ballbot_ros.recording.schemas import encoder, new_message
from ballbot_ros.robot.brick.brick import DeviceInputs
from ballbot_ros.robot.brick.sensors import (
    NO_DATA_CM,
    NO_ECHO_CM,
    degrees_to_radians,
    metres_to_sonar_cm,
    radians_to_degrees,
    sonar_cm_to_metres,
)
from ballbot_ros.robot.plant.ground_truth import STEP_VALUES, GroundTruth, Pair

STEP_FIELDS = ('motor_x', 'motor_y', 'angular_velocity_y', 'angular_velocity_x', 'x', 'y')
"""Of planes x and y in turn; units and signs are those of ``plant/joint_states``, ``plant/imu`` and
``plant/odom``."""

_FIELD = 'sensor_msgs/msg/PointField'
_POINT = 8 * STEP_VALUES


def encode_steps(truth: GroundTruth) -> bytes:
    """Return ``plant/steps``: a point for each step, the oldest first, that of the stamp last."""
    numbers = struct.pack(f'<{len(truth.steps)}d', *_with_other_sign(truth.steps))
    before, after = _around_steps(len(numbers))
    return b''.join((with_stamp(before, truth.stamp_ns), numbers, after))


def decode_steps(data: bytes, count: int) -> tuple[float, ...]:
    """Return the newest steps of ``plant/steps`` as in `GroundTruth`.

    It raises ValueError if the message has other fields, or not as many steps.
    """
    numbers = _numbers_of_steps(data)
    first = len(numbers) - count * _POINT
    if first < 0:
        raise ValueError(f'it has no step that is {count - 1} steps old')
    steps = struct.unpack_from(f'<{count * STEP_VALUES}d', numbers, first)
    return tuple(_with_other_sign(steps))


def _with_other_sign(steps: tuple[float, ...]) -> list[float]:
    """Return steps with y reversed: those of the truth as in the message, and back."""
    found = list(steps)
    found[STEP_VALUES - 1 :: STEP_VALUES] = [-y for y in found[STEP_VALUES - 1 :: STEP_VALUES]]
    return found


def _numbers_of_steps(data: bytes) -> bytes:
    before, after = _around_steps(0)
    # The middleware appends bytes up to a multiple of four.
    size = (len(data) - len(before) - len(after)) // _POINT * _POINT
    if size > 0:
        before, after = _around_steps(size)
        end = len(before) + size
        is_known = data.startswith(before[:4]) and data.startswith(before[12:], 12)
        if is_known and data.startswith(after, end):
            return data[len(before) : end]
    message = decoder(topics.PLANT_STEPS.type_name)(data)
    if _layout(message.fields) != _layout(_fields()) or message.point_step != _POINT:
        raise ValueError(f'the fields are not {", ".join(STEP_FIELDS)}')
    return bytes(message.data)


@lru_cache(8)
def _around_steps(size: int) -> tuple[bytes, bytes]:
    """Return what is before and after so many bytes of steps; only the stamp varies."""
    message = new_message(topics.PLANT_STEPS.type_name)
    message.header.frame_id = 'map'
    message.fields = _fields()
    message.height, message.width = 1, size // _POINT
    message.point_step, message.row_step = _POINT, size
    message.data, message.is_dense = bytes(size), True
    data = encoder(topics.PLANT_STEPS.type_name)(message)
    return data[: -1 - size], data[-1:]


@cache
def _fields() -> list[object]:
    fields = []
    for number, name in enumerate(STEP_FIELDS):
        field = new_message(_FIELD)
        field.name, field.count, field.datatype = name, 1, field.FLOAT64
        field.offset = number * 8
        fields.append(field)
    return fields


def _layout(fields: list[Any]) -> list[tuple[str, int, int]]:
    return [(each.name, each.offset, each.datatype) for each in fields]


ULTRASOUND = 0
_COUNTS = 2**31


class AnsweredTopic(NamedTuple):
    """The plant's messages that a driver answers.

    `measured` returns the measured quantity of a message and its stamp [ns]. Raises ValueError if
    the message is malformed.
    """

    topic: Topic
    measured: Callable[[bytes, int], Pair]


@dataclass(frozen=True)
class DeviceMessages(Generic[P, Reading]):
    """The input and output messages of a device's driver.

    Attributes
    ----------
    truth : Topic
        The plant's topic that the driver answers, if its samples have no dead time.
    encoder : callable
        Returns, for the driver's parameters, the function that encodes the stamp [ns] and the
        reading of a sample.
    reading : callable
        Returns the reading from a sample. Raises ValueError if no such device can have sent it.
    """

    device: Device[P, Reading]
    truth: Topic
    measured: Callable[[bytes], Pair]
    sample: Topic
    encoder: Callable[[P], Callable[[int, Reading], bytes]]
    reading: Callable[[bytes], Reading]

    def source(self, parameters: P, start_ns: int) -> AnsweredTopic:
        """Return what a driver answers in a run that begins at a time [ns]."""
        if not self.device.longest_delay(parameters):
            return AnsweredTopic(self.truth, lambda data, stamp_ns: self.measured(data))
        age_of = self.device.age_of(parameters, start_ns)

        def measured(data: bytes, stamp_ns: int) -> Pair:
            ages, share = age_of(stamp_ns)
            return self.device.measured_of(decode_steps(data, max(ages) + 1), ages, share)

        return AnsweredTopic(topics.PLANT_STEPS, measured)


_GYRO = MessageLayout(
    topics.GYRO_IMU.type_name,
    ['angular_velocity.y', 'angular_velocity.x'],
    {
        'header.frame_id': 'base_link',
        'orientation_covariance[0]': NOT_PROVIDED,
        'linear_acceleration_covariance[0]': NOT_PROVIDED,
    },
)
_ENCODERS = MessageLayout(
    topics.JOINT_STATES.type_name,
    elements('position', 2),
    {'name': MOTOR_NAMES, 'position': [0.0] * 2},
    identity='name',
)
_SONAR = MessageLayout(
    topics.SONAR_RANGE.type_name,
    ['range', 'field_of_view'],
    {
        'header.frame_id': 'sonar',
        'radiation_type': ULTRASOUND,
        'min_range': 0.0,
        'max_range': sonar_cm_to_metres(NO_ECHO_CM - 1),
    },
)


def encode_gyro(stamp_ns: int, counts: tuple[int, int]) -> bytes:
    """Return ``gyro``: the readings in rad/s, with their zero-rate offset."""
    return _GYRO.encode(stamp_ns, degrees_to_radians(counts[0]), degrees_to_radians(counts[1]))


def decode_gyro(data: bytes) -> tuple[int, int]:
    """Return the readings [deg/s + offset] of gyros S1 and S2 from ``gyro``."""
    rate_x, rate_y = _GYRO.decode(data)
    return radians_to_degrees(rate_x), radians_to_degrees(rate_y)


def encode_encoders(stamp_ns: int, counts: tuple[int, int]) -> bytes:
    """Return ``joint_states``: whole degrees as rad."""
    return _ENCODERS.encode(stamp_ns, degrees_to_radians(counts[0]), degrees_to_radians(counts[1]))


def decode_encoders(data: bytes) -> tuple[int, int]:
    """Return the counts [deg] of motors B and C from ``joint_states``.

    It raises ValueError if the message has other joints, or a count that exceeds 32 bits.
    """
    counts = tuple(radians_to_degrees(angle) for angle in _ENCODERS.decode(data))
    for count in counts:
        if not -_COUNTS <= count < _COUNTS:
            raise ValueError(f'{count:.4g} degrees exceed a counter of 32 bits')
    return counts[0], counts[1]


def encode_sonar(stamp_ns: int, sonar_cm: int, cone_angle: float = 0.0) -> bytes:
    """Return ``sonar``; a single ray has no field of view."""
    return _SONAR.encode(stamp_ns, sonar_cm_to_metres(sonar_cm), cone_angle)


def decode_sonar(data: bytes) -> int:
    """Return the reading [cm] from ``sonar``.

    It raises ValueError if the sensor's register can't hold it.
    """
    distance = _SONAR.decode(data)[0]
    if distance == -math.inf:
        raise ValueError('-inf m is no distance')
    reading = metres_to_sonar_cm(distance)
    if not NO_DATA_CM <= reading <= NO_ECHO_CM:
        raise ValueError(f'{reading} cm is not within 0 … {NO_ECHO_CM}')
    return reading


AnyDeviceMessages: TypeAlias = DeviceMessages[Any, Any]
"""The messages of any device."""

DEVICE_MESSAGES: tuple[AnyDeviceMessages, ...] = (
    DeviceMessages(
        GYRO_DEVICE, topics.PLANT_IMU, decode_body_rates,
        topics.GYRO_IMU, lambda parameters: encode_gyro, decode_gyro,
    ),
    DeviceMessages(
        ENCODER_DEVICE, topics.PLANT_JOINT_STATES, decode_motor_angles,
        topics.JOINT_STATES, lambda parameters: encode_encoders, decode_encoders,
    ),
    DeviceMessages(
        SONAR_DEVICE, topics.PLANT_SLOW_ODOM, decode_ball_position, topics.SONAR_RANGE,
        lambda parameters: partial(encode_sonar, cone_angle=parameters.cone_angle), decode_sonar,
    ),
)  # fmt: skip


_INPUTS: dict[str, tuple[Topic, Callable[[bytes], Any]]] = {
    **{each.device.field: (each.sample, each.reading) for each in DEVICE_MESSAGES},
    'sticks': (topics.GAMEPAD_JOY, decode_sticks),
    'battery_mv': (topics.BATTERY_STATE, decode_battery_mv),
}
_TOPICS = tuple(_INPUTS[field][0] for field in DeviceInputs._fields)

INPUT_READERS = dict(_INPUTS.values())
"""For each topic that the controller reads, the function that reads its messages."""


def device_inputs(sample: Callable[[Topic], Any]) -> DeviceInputs:
    """Return the inputs of a tick; `sample` gives the sample of a topic, None if it has none."""
    return DeviceInputs._make([sample(topic) for topic in _TOPICS])
