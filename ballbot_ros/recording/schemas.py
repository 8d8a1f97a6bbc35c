"""Message definitions of ROS 2 Jazzy, without ROS: text, hash and types from rosbags."""

from __future__ import annotations

import re
from functools import cache
from typing import NamedTuple

from rosbags.typesys import Stores, get_typestore
from rosbags.typesys.store import Typestore

from ballbot_ros.recording.errors import RecordingError

_CHAR_FIELD = re.compile(r'^char\b', re.MULTILINE)


class Schema(NamedTuple):
    """A message type's definition.

    Attributes
    ----------
    text : str
        The definition in ``ros2msg`` form, followed by those of all types it is made of.
    type_hash : str
        The REP 2011 hash, ``RIHS01_...``; empty for a type with a char, which rosbags takes for
        another type than uint8.
    """

    text: str
    type_hash: str


@cache
def typestore() -> Typestore:
    """Return the message types of ROS 2 Jazzy."""
    return get_typestore(Stores.ROS2_JAZZY)


@cache
def schema(type_name: str) -> Schema:
    """Return the definition of `type_name`, such as ``sensor_msgs/msg/Imu``.

    Raises
    ------
    RecordingError
        If ROS 2 Jazzy has no such type.
    """
    store = typestore()
    if type_name not in store.fielddefs:
        raise RecordingError(f'{type_name!r} is not a message type of ROS 2 Jazzy')
    text, _ = store.generate_msgdef(type_name, ros_version=2)
    type_hash = '' if _CHAR_FIELD.search(text) else store.hash_rihs01(type_name)
    return Schema(text, type_hash)
