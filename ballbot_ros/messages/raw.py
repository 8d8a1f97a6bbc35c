"""Serialised messages: their stamps, and decoding them.

Decoding with rosbags takes a third of the time of rclpy's own conversion, and most
messages of the loop are read by several nodes.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from typing import Any

from rosbags.interfaces import Nodetype
from rosbags.serde import SerdeError

from ballbot_ros.recording.encoding import encoder
from ballbot_ros.recording.schemas import typestore
from ballbot_ros.timing import SECOND_NS

# In CDR, the first field, here a time, follows four bytes of encoding.
_STAMP = struct.Struct('<4xiI')
_STAMPS = ('std_msgs/msg/Header', 'builtin_interfaces/msg/Time')


def stamp_of(data: bytes) -> int:
    """Return the stamp [ns] of a serialised message that begins with a header or a time.

    It raises ValueError if the message is too short.
    """
    try:
        seconds, nanoseconds = _STAMP.unpack_from(data)
    except struct.error as error:
        raise ValueError(str(error)) from None
    return int(seconds) * SECOND_NS + int(nanoseconds)


def has_stamp(type_name: str) -> bool:
    """Return whether messages of this type begin with a header or a time."""
    kind, detail = typestore().fielddefs[type_name][1][0][1]
    return kind == Nodetype.NAME and detail in _STAMPS


def same_content(type_name: str) -> Callable[[bytes, bytes], bool]:
    """Return a function that compares the content of two serialised messages of a type.

    Equal messages may differ in their bytes, because padding is not cleared.
    """
    decode, encode = decoder(type_name), encoder(type_name)

    def is_same(one: bytes, other: bytes) -> bool:
        return one == other or encode(decode(one)) == encode(decode(other))

    return is_same


def decoder(type_name: str) -> Callable[[bytes], Any]:
    """Return a function that decodes serialised messages of a type.

    It raises ValueError for malformed bytes, such as text that is not UTF-8.
    """
    deserialize = typestore().deserialize_cdr

    def decode(data: bytes) -> Any:
        try:
            return deserialize(data, type_name)
        except SerdeError as error:
            raise ValueError(str(error)) from None

    return decode
