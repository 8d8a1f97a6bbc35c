"""Stamps of messages that were not decoded."""

from __future__ import annotations

from builtin_interfaces.msg import Time
from rclpy.serialization import deserialize_message

from ballbot_ros.nodes.conversions import time_ns


def stamp_of(data: bytes) -> int:
    """Return the stamp [ns] of a serialised message that begins with a header or a time.

    Only the leading time is decoded: a whole nav_msgs/Odometry takes ten times as long.
    """
    return time_ns(deserialize_message(data, Time))
