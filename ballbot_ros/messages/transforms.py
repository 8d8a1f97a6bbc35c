"""Transforms between frames as serialised messages."""

from __future__ import annotations

import struct
from collections.abc import Iterable, Mapping
from typing import NamedTuple

from ballbot_ros.messages.topics import TF
from ballbot_ros.recording.encoding import encoder, new_message
from ballbot_ros.timing import SECOND_NS

_STAMP = struct.Struct('<iI')
_POSE = struct.Struct('<7d')


class Pose(NamedTuple):
    """Position [m] and unit quaternion w, x, y, z of a frame in another one."""

    position: tuple[float, float, float]
    rotation: tuple[float, float, float, float]


class TransformsLayout:
    """Messages with the transforms of the same frames, encoded without message objects.

    ``tf2_msgs`` need not be installed.

    Parameters
    ----------
    parents : mapping of str to str
        The parent of each frame, in the order of the transforms.
    """

    def __init__(self, parents: Mapping[str, str]) -> None:
        message = new_message(TF.type_name)
        marks = range(1, len(parents) + 1)
        for mark, (frame, parent) in zip(marks, parents.items(), strict=True):
            each = new_message('geometry_msgs/msg/TransformStamped')
            each.header.stamp.sec, each.header.frame_id = -mark, parent
            each.child_frame_id, each.transform.translation.x = frame, float(mark)
            message.transforms.append(each)
        self._template = encoder(TF.type_name)(message)
        self._places = [
            (
                self._template.index(_STAMP.pack(-mark, 0)),
                self._template.index(_POSE.pack(mark, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)),
            )
            for mark in marks
        ]

    def encode(self, stamp_ns: int, poses: Iterable[Pose]) -> bytes:
        """Return the message with the pose of each frame in its parent, all at `stamp_ns`."""
        data = bytearray(self._template)
        stamp = divmod(stamp_ns, SECOND_NS)
        for (stamp_at, pose_at), (position, (w, x, y, z)) in zip(self._places, poses, strict=True):
            _STAMP.pack_into(data, stamp_at, *stamp)
            _POSE.pack_into(data, pose_at, *position, x, y, z, w)
        return bytes(data)
