"""Definitions and messages of ROS 2 Jazzy without ROS, by rosbags."""

from __future__ import annotations

import re
from collections.abc import Callable
from functools import cache, lru_cache
from typing import Any, NamedTuple, cast

import numpy as np
from mcap import records
from mcap.well_known import SchemaEncoding
from rosbags.interfaces import Nodetype
from rosbags.interfaces.typing import FieldDesc, Typesdict
from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore
from rosbags.typesys.base import TypesysError
from rosbags.typesys.store import Typestore
from rosbags.typesys.stores import ros2_jazzy as jazzy

from ballbot_ros.errors import RecordingError, one_line

# The types that this package fills and reads; the classes of rclpy have the same fields, untyped.
Time = jazzy.builtin_interfaces__msg__Time
Header = jazzy.std_msgs__msg__Header
Bytes = jazzy.std_msgs__msg__UInt8MultiArray
Twist = jazzy.geometry_msgs__msg__Twist
Vector3Stamped = jazzy.geometry_msgs__msg__Vector3Stamped
WrenchStamped = jazzy.geometry_msgs__msg__WrenchStamped
Imu = jazzy.sensor_msgs__msg__Imu
JointState = jazzy.sensor_msgs__msg__JointState
Joy = jazzy.sensor_msgs__msg__Joy
OccupancyGridMessage = jazzy.nav_msgs__msg__OccupancyGrid
Odometry = jazzy.nav_msgs__msg__Odometry
DiagnosticStatus = jazzy.diagnostic_msgs__msg__DiagnosticStatus
ParameterMessage = jazzy.rcl_interfaces__msg__Parameter
ParameterEvent = jazzy.rcl_interfaces__msg__ParameterEvent

_parse = lru_cache(maxsize=64)(get_types_from_msg)  # takes milliseconds, and each pass asks again

MAX_FIELDS = 100_000
"""Largest number of fields of a message, with those of its parts and fixed arrays."""

_CHAR_FIELD = re.compile(r'^char\b', re.MULTILINE)


class Schema(NamedTuple):
    """Definition of a message type.

    Attributes
    ----------
    text : str
        The definition in ``ros2msg`` format, followed by those of all nested types.
    type_hash : str
        REP 2011 hash, ``RIHS01_...``; empty for a type with a char, which rosbags does not treat as
        uint8.
    """

    text: str
    type_hash: str


@cache
def typestore() -> Typestore:
    """Return the message types of ROS 2 Jazzy."""
    return get_typestore(Stores.ROS2_JAZZY)


def _store_of(type_name: str) -> Typestore:
    """Return the message types of ROS 2 Jazzy; RecordingError if this is none of them."""
    store = typestore()
    if type_name not in store.fielddefs:
        raise RecordingError(f'{type_name!r} is not a message type of ROS 2 Jazzy')
    return store


@cache
def schema(type_name: str) -> Schema:
    """Return the definition of `type_name`, such as ``sensor_msgs/msg/Imu``.

    It raises RecordingError if ROS 2 Jazzy has no such type.
    """
    store = _store_of(type_name)
    text, _ = store.generate_msgdef(type_name, ros_version=2)
    type_hash = '' if _CHAR_FIELD.search(text) else store.hash_rihs01(type_name)
    return Schema(text, type_hash)


def recorded_typestore(definition: records.Schema) -> Typestore:
    """Return the message types of ROS 2 Jazzy, updated with a definition from a recording.

    The type of that name in ROS 2 Jazzy may have other fields. It raises RecordingError if neither
    the recording nor ROS 2 Jazzy defines the type.
    """
    ours = typestore()
    name, text = definition.name, definition.data.decode(errors='replace')
    if not text:
        schema(name)
        return ours
    try:
        if definition.encoding == SchemaEncoding.ROS2:
            types = _parse(text, name)
        elif definition.encoding == 'ros2idl':
            types = get_types_from_idl(text)
        else:
            raise RecordingError(f'{definition.encoding!r} is not an encoding of ROS 2 types')
        if name not in types:
            raise RecordingError('its definition belongs to another type')
        others = {
            known: definition
            for known, definition in types.items()
            if known not in ours.fielddefs or definition[1] != ours.fielddefs[known][1]
        }
        if not others:
            return ours
        store = get_typestore(Stores.EMPTY)
        store.register(_needed({**ours.fielddefs, **others}, name))
        store.get_msgdef(name)
    except (TypesysError, KeyError, SyntaxError, ValueError) as error:
        raise RecordingError(f'its definition is invalid: {one_line(error)}') from None
    except RecursionError:
        raise RecordingError('its definition contains itself, or is nested too deeply') from None
    return store


def _needed(types: Typesdict, name: str) -> Typesdict:
    """Return the definition of a type and of its parts, which have a limited number of fields."""
    counts: dict[str, int] = {}

    def in_type(name: str) -> int:
        if name not in counts:
            counts[name] = 1 + sum(in_field(description) for _, description in types[name][1])
        return counts[name]

    def in_field(description: FieldDesc) -> int:
        kind, content = description
        if kind in (Nodetype.ARRAY, Nodetype.SEQUENCE):
            element, size = cast('tuple[FieldDesc, int]', content)
            return in_field(element) * (size if kind == Nodetype.ARRAY else 1)
        return in_type(str(content)) if kind == Nodetype.NAME else 1

    if in_type(name) > MAX_FIELDS:
        raise RecordingError(f'its definition has more than {MAX_FIELDS} fields')
    return {each: types[each] for each in counts}


_Description = tuple[Nodetype, Any]
"""Kind and details of a field: a base type, a message type, or an element type and a count."""

_DEFAULTS: dict[tuple[str, str], Any] = {
    ('geometry_msgs/msg/Quaternion', 'w'): 1.0,
    ('sensor_msgs/msg/NavSatStatus', 'status'): -2,
}
"""Nonzero defaults in Jazzy's .msg files, which rosbags does not keep."""


def new_message(type_name: str) -> Any:
    """Create a rosbags message of `type_name` with the defaults of its definition.

    Its arrays and sequences of numbers are those of numpy. It raises RecordingError if ROS 2 Jazzy
    has no such type.
    """
    store = _store_of(type_name)
    return store.types[type_name](
        *(
            _DEFAULTS.get((type_name, name), _blank(description))
            for name, description in store.fielddefs[type_name][1]
        )
    )


@cache
def encoder(type_name: str) -> Callable[[Any], bytes]:
    """Return the function that encodes a rosbags message of `type_name` as little-endian CDR.

    A top-level array of numbers may be any sequence or bytes; the function converts it to the numpy
    array that rosbags requires. In nested messages it must already be that array. It raises
    RecordingError if ROS 2 Jazzy has no such type.
    """
    store = _store_of(type_name)

    @cache
    def arrays() -> list[tuple[str, np.dtype[Any]]]:
        blanks = ((name, _blank(kind)) for name, kind in store.fielddefs[type_name][1])
        return [(name, blank.dtype) for name, blank in blanks if isinstance(blank, np.ndarray)]

    def encode(message: object) -> bytes:
        for name, dtype in arrays():
            value = getattr(message, name)
            if getattr(value, 'dtype', None) is not dtype:
                numbers = memoryview(value) if isinstance(value, bytes) else value
                setattr(message, name, np.asarray(numbers, dtype))
        return bytes(store.serialize_cdr(message, type_name))

    return encode


def _blank(description: _Description) -> object:
    kind, detail = description
    if kind == Nodetype.NAME:
        return new_message(detail)
    if kind == Nodetype.BASE:
        dtype = _dtype(description)
        return '' if dtype is None else dtype.type().item()
    element, count = detail if kind == Nodetype.ARRAY else (detail[0], 0)
    dtype = _dtype(element)
    return [_blank(element) for _ in range(count)] if dtype is None else np.zeros(count, dtype)


def _dtype(description: _Description) -> np.dtype[Any] | None:
    """Return the dtype of a number, None for everything else."""
    kind, detail = description
    if kind != Nodetype.BASE or detail[0] == 'string':
        return None
    return np.dtype('uint8' if detail[0] == 'char' else detail[0])
