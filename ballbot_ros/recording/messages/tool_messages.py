"""Messages for other tools: transforms, odometry and markers."""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from ballbot_ros.parameters.timing import SECOND_NS
from ballbot_ros.recording.messages.conversions import NOT_PROVIDED, body_orientation, fill_header
from ballbot_ros.recording.messages.raw import MessageLayout, Messages, Stamps, fill
from ballbot_ros.recording.messages.topics import IMU_DATA, ODOM, TF
from ballbot_ros.recording.schemas import encoder, new_message
from ballbot_ros.robot.brick.odometry import OdometryState

_STAMP = struct.Struct('<iI')
_POSE = struct.Struct('<7d')


class FramePose(NamedTuple):
    """Position [m] and unit quaternion w, x, y, z of a frame in another one.

    The numbers may be columns: the poses at many ticks.
    """

    position: tuple[Any, Any, Any]
    rotation: tuple[Any, Any, Any, Any]


class TransformsLayout:
    """Messages with the transforms of the same frames, encoded without message objects.

    ``tf2_msgs`` need not be installed. `parents` has the parent of each frame, in the order of the
    transforms.
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
        offsets = []
        for mark in marks:
            stamp_at = self._template.index(_STAMP.pack(-mark, 0))
            pose_at = self._template.index(_POSE.pack(mark, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0))
            offsets += [stamp_at, stamp_at + 4, *range(pose_at, pose_at + _POSE.size, 8)]
        self._row = np.dtype({
            'names': [str(number) for number in range(len(offsets))],
            'formats': ['<i4', '<u4', *['<f8'] * 7] * len(parents),
            'offsets': offsets,
            'itemsize': len(self._template),
        })  # fmt: skip

    def encode(self, stamps_ns: Stamps, poses: Iterable[FramePose]) -> Messages:
        """Return the messages with the poses of each frame in its parent, all at `stamps_ns`."""
        stamp, columns = divmod(stamps_ns, SECOND_NS), list[Any]()
        for position, (w, x, y, z) in poses:
            columns += [*stamp, *position, x, y, z, w]
        return fill(self._template, self._row, len(stamps_ns), columns)


ODOM_FRAME, FOOTPRINT = 'odom', 'base_footprint'

EXACT = 1e-9
"""Variance of what is known by definition, in SI: ``base_footprint`` is level and on the floor, and
the robot has no yaw. It is not zero, because filters invert the covariance."""

_ROWS_3, _ROWS_6 = 4, 7
"""Distance of the elements on the diagonal of a covariance with three and with six rows."""


def _covariance(name: str, rows: int, *exact: int) -> dict[str, float]:
    return {f'{name}[{rows * number}]': EXACT for number in exact}


_ODOM = MessageLayout(
    ODOM.type_name,
    [
        'pose.pose.position.x', 'pose.pose.position.y', 'pose.covariance[0]', 'pose.covariance[7]',
        'twist.twist.linear.x', 'twist.twist.linear.y',
        'twist.covariance[0]', 'twist.covariance[7]',
    ],
    {
        'header.frame_id': ODOM_FRAME,
        'child_frame_id': FOOTPRINT,
        **_covariance('pose.covariance', _ROWS_6, 2, 3, 4, 5),
        **_covariance('twist.covariance', _ROWS_6, 2, 3, 4, 5),
    },
)  # fmt: skip
_IMU = MessageLayout(
    IMU_DATA.type_name,
    [
        'orientation.w', 'orientation.x', 'orientation.y', 'orientation.z',
        'orientation_covariance[0]', 'orientation_covariance[4]',
        'angular_velocity.x', 'angular_velocity.y',
        'angular_velocity_covariance[0]', 'angular_velocity_covariance[4]',
    ],
    {
        'header.frame_id': 'base_link',
        **_covariance('orientation_covariance', _ROWS_3, 2),
        **_covariance('angular_velocity_covariance', _ROWS_3, 2),
        'linear_acceleration_covariance[0]': NOT_PROVIDED,
    },
)  # fmt: skip


def encode_odom(stamps_ns: Stamps, state: OdometryState) -> Messages:
    """Return ``odom`` at ticks: pose of ``base_footprint`` in ``odom``, and its velocity."""
    (x, y), position_variance = state.position
    (speed_x, speed_y), speed_variance = state.velocity
    return _ODOM.encode(stamps_ns, x, -y, *position_variance, speed_x, -speed_y, *speed_variance)


def encode_imu_data(stamps_ns: Stamps, state: OdometryState) -> Messages:
    """Return ``imu/data`` at ticks: roll is plane y's pitch angle, pitch is plane x's, no yaw."""
    (rate_x, rate_y), (rate_variance_x, rate_variance_y) = state.pitch_rate
    variance_x, variance_y = state.pitch.variance
    return _IMU.encode(
        stamps_ns,
        *body_orientation(state.pitch.value),
        variance_y,
        variance_x,
        rate_y,
        rate_x,
        rate_variance_y,
        rate_variance_x,
    )


ADD, DELETE, DELETE_ALL = 0, 2, 3
"""The actions of ``visualization_msgs/Marker``."""

SHAPES = {'box': 1, 'sphere': 2, 'cylinder': 3, 'line': 4, 'text': 9, 'triangles': 11}
"""Marker types: CUBE, SPHERE, CYLINDER, LINE_STRIP, TEXT_VIEW_FACING, TRIANGLE_LIST."""


_SCALES: Mapping[str, Callable[[Sequence[float]], Sequence[float]]] = {
    'box': lambda size: size,
    'cylinder': lambda size: (2.0 * size[0], 2.0 * size[0], size[1]),
    'sphere': lambda size: (2.0 * size[0],) * 3,
    'line': lambda size: (size[0], 0.0, 0.0),
    'text': lambda size: (0.0, 0.0, size[0]),
    'triangles': lambda size: (1.0, 1.0, 1.0),
}


def fill_marker(
    message: Any,
    namespace: str,
    number: int,
    shape: str,
    size: Sequence[float],
    colour: Sequence[float],
    opacity: float = 1.0,
) -> Any:
    """Write a ``visualization_msgs/Marker`` except for its pose, and return it.

    Parameters
    ----------
    shape : str
        A key of :data:`SHAPES`.
    size : sequence of float
        A box's x, y and z; a cylinder's radius and length; a sphere's radius; a line's width; the
        height of the letters of a text [m]. Triangles ignore it.
    colour : sequence of int
        Red, green, blue, 0 ... 255.
    """
    message.ns, message.id, message.type = namespace, number, SHAPES[shape]
    message.action = ADD
    message.scale.x, message.scale.y, message.scale.z = _SCALES[shape](size)
    red, green, blue = (channel / 255.0 for channel in colour)
    message.color.r, message.color.g, message.color.b = red, green, blue
    message.color.a = opacity
    return message


def place_marker(
    message: Any,
    stamp_ns: int,
    position: Sequence[float],
    rotation: Sequence[float] = (1.0, 0.0, 0.0, 0.0),
) -> None:
    """Write the pose of a marker in ``map`` at `stamp_ns`; `rotation` is w, x, y, z."""
    fill_header(message.header, stamp_ns, 'map')
    point, quaternion = message.pose.position, message.pose.orientation
    point.x, point.y, point.z = position
    quaternion.w, quaternion.x, quaternion.y, quaternion.z = rotation


def fill_points(message: Any, points: Iterable[Sequence[float]]) -> None:
    """Write the points of a line or of triangles [m]."""
    new_point = type(message.pose.position)
    message.points = [new_point(x=x, y=y, z=z) for x, y, z in points]
