"""Messages without a graph: creation with defaults, and CDR encoding, both by rosbags."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from rosbags.interfaces import Nodetype

from ballbot_ros.recording.schemas import schema, typestore

_Description = tuple[Nodetype, Any]
"""Kind and details of a field: a base type, a message type, or an element type and a count."""

_DEFAULTS: dict[tuple[str, str], Any] = {
    ('geometry_msgs/msg/Quaternion', 'w'): 1.0,
    ('sensor_msgs/msg/NavSatStatus', 'status'): -2,
}
"""Nonzero defaults in Jazzy's .msg files, which rosbags does not keep."""


def new_message(type_name: str) -> Any:
    """Create a message of `type_name` with the defaults of its definition.

    Returns
    -------
    object
        A rosbags message, with numpy arrays for arrays and sequences of numbers.

    Raises
    ------
    RecordingError
        If ROS 2 Jazzy has no such type.
    """
    schema(type_name)
    store = typestore()
    return store.types[type_name](
        *(
            _DEFAULTS.get((type_name, name), _blank(description))
            for name, description in store.fielddefs[type_name][1]
        )
    )


def encoder(type_name: str) -> Callable[[Any], bytes]:
    """Return the function that encodes a rosbags message of `type_name` as little-endian CDR.

    A top-level array of numbers may be any sequence or bytes; the function converts it to the numpy
    array that rosbags requires. In nested messages it must already be that array.

    Raises
    ------
    RecordingError
        If ROS 2 Jazzy has no such type.
    """
    schema(type_name)
    store = typestore()
    fields = store.get_msgdef(type_name).fields  # creates the serialiser before the first call
    blanks = ((name, _blank(description)) for name, description in fields)
    arrays = [(name, blank.dtype) for name, blank in blanks if isinstance(blank, np.ndarray)]

    def encode(message: Any) -> bytes:
        for name, dtype in arrays:
            value = getattr(message, name)
            if getattr(value, 'dtype', None) is not dtype:
                numbers = memoryview(value) if isinstance(value, bytes) else value
                setattr(message, name, np.asarray(numbers, dtype))
        return bytes(store.serialize_cdr(message, type_name))

    return encode


def _blank(description: _Description) -> Any:
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
