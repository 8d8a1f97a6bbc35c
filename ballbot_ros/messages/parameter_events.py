"""Changes of the controller's parameters during a run, as ``rcl_interfaces/ParameterEvent``."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ballbot_ros.messages.conversions import fill_time
from ballbot_ros.messages.message_types import ParameterEvent, ParameterMessage
from ballbot_ros.messages.raw import decoder
from ballbot_ros.messages.topics import PARAMETER_EVENTS
from ballbot_ros.parameters import CONTROLLER, Value
from ballbot_ros.recording.encoding import encoder, new_message

_FIELDS = {
    bool: (1, 'bool_value'),
    int: (2, 'integer_value'),
    float: (3, 'double_value'),
    str: (4, 'string_value'),
    tuple: (8, 'double_array_value'),
}
"""Number of each type of ``rcl_interfaces/ParameterType``, and the field of its values."""

_KINDS = {number: (kind, name) for kind, (number, name) in _FIELDS.items()}
_encode, _decode = encoder(PARAMETER_EVENTS.type_name), decoder(PARAMETER_EVENTS.type_name)


def encode_parameter_event(stamp_ns: int, values: Mapping[str, Value]) -> bytes:
    """Return ``controller/parameter_events``: new values by name, from the tick `stamp_ns` on."""
    message = new_message(PARAMETER_EVENTS.type_name)
    fill_time(message.stamp, stamp_ns)
    message.node = CONTROLLER
    for name, value in values.items():
        each = new_message('rcl_interfaces/msg/Parameter')
        each.name = name
        number, field = _FIELDS[type(value)]
        each.value.type = number
        setattr(each.value, field, np.array(value) if isinstance(value, tuple) else value)
        message.changed_parameters.append(each)
    return _encode(message)


def decode_parameter_event(data: bytes) -> dict[str, Value]:
    """Return the new values of ``controller/parameter_events``, by name.

    It raises ValueError for a malformed message, or a type that no parameter here has.
    """
    message: ParameterEvent = _decode(data)
    return {each.name: _value(each) for each in message.changed_parameters}


def _value(message: ParameterMessage) -> Value:
    if message.value.type not in _KINDS:
        raise ValueError(f'{message.name}: type {message.value.type} of its value')
    kind, field = _KINDS[message.value.type]
    value: Value = kind(getattr(message.value, field))
    return tuple(map(float, value)) if isinstance(value, tuple) else value
