"""Markers for other tools, from plain values, as in conversions.py."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

from ballbot_ros.messages.conversions import fill_header

ADD, DELETE, DELETE_ALL = 0, 2, 3
"""The actions of ``visualization_msgs/Marker``."""

SHAPES = {'box': 1, 'sphere': 2, 'cylinder': 3, 'line': 4, 'text': 9, 'triangles': 11}
"""Marker types: CUBE, SPHERE, CYLINDER, LINE_STRIP, TEXT_VIEW_FACING, TRIANGLE_LIST."""


def fill_marker(
    message: Any,
    namespace: str,
    number: int,
    shape: str,
    size: Sequence[float],
    colour: Sequence[float],
    opacity: float = 1.0,
) -> None:
    """Write a ``visualization_msgs/Marker`` except for its pose.

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
    if shape == 'box':
        scale = tuple(size)
    elif shape == 'cylinder':
        scale = (2.0 * size[0], 2.0 * size[0], size[1])
    elif shape == 'sphere':
        scale = (2.0 * size[0],) * 3
    elif shape == 'line':
        scale = (size[0], 0.0, 0.0)
    elif shape == 'text':
        scale = (0.0, 0.0, size[0])
    else:
        scale = (1.0, 1.0, 1.0)
    message.scale.x, message.scale.y, message.scale.z = scale
    red, green, blue = (channel / 255.0 for channel in colour)
    message.color.r, message.color.g, message.color.b = red, green, blue
    message.color.a = opacity


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
