"""The plant's latest physics steps, for drivers whose samples have a dead time.

A message has no fixed layout, since the number of steps depends on the drivers of the run.
"""

from __future__ import annotations

import struct
from functools import cache
from typing import Any

from ballbot_ros.messages.conversions import fill_header
from ballbot_ros.messages.raw import decoder
from ballbot_ros.messages.topics import PLANT_STEPS
from ballbot_ros.plant.ground_truth import GroundTruth, MeasuredState
from ballbot_ros.recording.encoding import encoder, new_message

STEP_FIELDS = ('motor_x', 'motor_y', 'angular_velocity_y', 'angular_velocity_x', 'x', 'y')
"""Of planes x and y in turn; units and signs are those of ``plant/joint_states``, ``plant/imu`` and
``plant/odom``."""

_STEP = struct.Struct(f'<{len(STEP_FIELDS)}d')
_FIELD = 'sensor_msgs/msg/PointField'

# Only a graph with dead time needs them.
_encoder, _decoder = cache(encoder), cache(decoder)


def encode_steps(truth: GroundTruth) -> bytes:
    """Return ``plant/steps``: a point for each step, the oldest first, that of the stamp last."""
    message = new_message(PLANT_STEPS.type_name)
    fill_header(message.header, truth.stamp_ns, 'map')
    message.fields = _fields()
    message.height, message.width = 1, len(truth.steps)
    message.point_step, message.row_step = _STEP.size, _STEP.size * len(truth.steps)
    message.data = b''.join(
        _STEP.pack(*angles, *rates, x, -y) for angles, rates, (x, y) in truth.steps
    )
    message.is_dense = True
    return _encoder(PLANT_STEPS.type_name)(message)


def decode_step(data: bytes, age: int) -> MeasuredState:
    """Return the step of ``plant/steps`` that is `age` steps older than the stamp.

    It raises ValueError if the message has other fields, or no such step.
    """
    message = _decoder(PLANT_STEPS.type_name)(data)
    if _layout(message.fields) != _layout(_fields()) or message.point_step != _STEP.size:
        raise ValueError(f'the fields are not {", ".join(STEP_FIELDS)}')
    offset = len(message.data) - (age + 1) * _STEP.size
    if offset < 0:
        raise ValueError(f'it has no step that is {age} steps old')
    motor_x, motor_y, rate_x, rate_y, x, y = _STEP.unpack_from(message.data, offset)
    return MeasuredState((motor_x, motor_y), (rate_x, rate_y), (x, -y))


@cache
def _fields() -> list[Any]:
    fields = []
    for number, name in enumerate(STEP_FIELDS):
        field = new_message(_FIELD)
        field.name, field.count, field.datatype = name, 1, field.FLOAT64
        field.offset = number * _STEP.size // len(STEP_FIELDS)
        fields.append(field)
    return fields


def _layout(fields: list[Any]) -> list[tuple[str, int, int]]:
    return [(each.name, each.offset, each.datatype) for each in fields]
