"""Messages as they come off the wire: their stamps, and decoding them.

Decoding with rosbags takes a third of the time that rclpy's own conversion takes, and most
messages of a loop are read by several nodes.
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

# After the four bytes that tell the encoding, CDR has the first field: here a time.
_STAMP = struct.Struct('<4xiI')
_STAMPS = ('std_msgs/msg/Header', 'builtin_interfaces/msg/Time')


def stamp_of(data: bytes) -> int:
    """Return the stamp [ns] of a serialised message that begins with a header or a time.

    ValueError for bytes that are too few to have one.
    """
    try:
        seconds, nanoseconds = _STAMP.unpack_from(data)
    except struct.error as error:
        raise ValueError(str(error)) from None
    return int(seconds) * SECOND_NS + int(nanoseconds)


def has_stamp(type_name: str) -> bool:
    """Tell whether messages of that type begin with a header or a time."""
    kind, detail = typestore().fielddefs[type_name][1][0][1]
    return kind == Nodetype.NAME and detail in _STAMPS


def same_content(type_name: str) -> Callable[[bytes, bytes], bool]:
    """Return a function that tells whether two serialised messages of that type say the same.

    Their bytes may differ all the same: nobody clears the gaps that align a number.
    """
    decode, encode = decoder(type_name), encoder(type_name)

    def is_same(one: bytes, other: bytes) -> bool:
        return one == other or encode(decode(one)) == encode(decode(other))

    return is_same


def decoder(type_name: str) -> Callable[[bytes], Any]:
    """Return a function that decodes a serialised message of that type.

    It raises ValueError for bytes that are none, such as text that is not UTF-8.
    """
    deserialize = typestore().deserialize_cdr

    def decode(data: bytes) -> Any:
        try:
            return deserialize(data, type_name)
        except SerdeError as error:
            raise ValueError(str(error)) from None

    return decode
