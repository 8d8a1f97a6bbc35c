"""Protocols with the fields of the messages that this package fills and reads.

The classes of rclpy and of rosbags have these fields, but neither library declares their types.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol


class Time(Protocol):
    """``builtin_interfaces/Time``."""

    sec: int
    nanosec: int


class Header(Protocol):
    """``std_msgs/Header``."""

    stamp: Time
    frame_id: str


class Stamped(Protocol):
    """A message with a header."""

    header: Header


class Vector3(Protocol):
    """``geometry_msgs/Vector3`` or ``Point``."""

    x: float
    y: float
    z: float


class Quaternion(Protocol):
    """``geometry_msgs/Quaternion``."""

    w: float
    x: float
    y: float
    z: float


class Pose(Protocol):
    """``geometry_msgs/Pose``."""

    position: Vector3


class PoseWithCovariance(Protocol):
    """``geometry_msgs/PoseWithCovariance``."""

    pose: Pose


class Twist(Protocol):
    """``geometry_msgs/Twist``."""

    linear: Vector3


class Wrench(Protocol):
    """``geometry_msgs/Wrench``."""

    force: Vector3
    torque: Vector3


class WrenchStamped(Stamped, Protocol):
    """``geometry_msgs/WrenchStamped``."""

    wrench: Wrench


class Joy(Stamped, Protocol):
    """``sensor_msgs/Joy``."""

    axes: Sequence[float]


class Vector3Stamped(Stamped, Protocol):
    """``geometry_msgs/Vector3Stamped``."""

    vector: Vector3


class Imu(Stamped, Protocol):
    """``sensor_msgs/Imu``."""

    orientation: Quaternion
    angular_velocity: Vector3


class TwistWithCovariance(Protocol):
    """``geometry_msgs/TwistWithCovariance``."""

    twist: Twist


class Odometry(Stamped, Protocol):
    """``nav_msgs/Odometry``."""

    pose: PoseWithCovariance
    twist: TwistWithCovariance


class JointState(Stamped, Protocol):
    """``sensor_msgs/JointState``."""

    position: Sequence[float]
    velocity: Sequence[float]


class MapMetaData(Protocol):
    """``nav_msgs/MapMetaData``."""

    resolution: float
    width: int
    height: int
    origin: Pose


class OccupancyGridMessage(Stamped, Protocol):
    """``nav_msgs/OccupancyGrid``."""

    info: MapMetaData
    data: Sequence[int]


class Bytes(Protocol):
    """``std_msgs/UInt8MultiArray``."""

    data: bytes


class KeyValue(Protocol):
    """``diagnostic_msgs/KeyValue``."""

    key: str
    value: str


class ParameterValue(Protocol):
    """``rcl_interfaces/ParameterValue``."""

    type: int


class ParameterMessage(Protocol):
    """``rcl_interfaces/Parameter``."""

    name: str
    value: ParameterValue


class ParameterEvent(Protocol):
    """``rcl_interfaces/ParameterEvent``."""

    changed_parameters: Sequence[ParameterMessage]


class DiagnosticStatus(Protocol):
    """``diagnostic_msgs/DiagnosticStatus``."""

    level: int
    name: str
    message: str
    hardware_id: str
    values: Sequence[KeyValue]
