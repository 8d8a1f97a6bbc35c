"""The motion that the robot measures itself, as messages for other tools."""

from __future__ import annotations

from ballbot_ros.brick.odometry import OdometryState
from ballbot_ros.messages.conversions import NOT_PROVIDED, body_orientation
from ballbot_ros.messages.layout import MessageLayout
from ballbot_ros.messages.topics import IMU_DATA, ODOM

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


def encode_odom(stamp_ns: int, state: OdometryState) -> bytes:
    """Return ``odom``: pose of ``base_footprint`` in ``odom``, and its velocity."""
    (x, y), position_variance = state.position
    (speed_x, speed_y), speed_variance = state.velocity
    return _ODOM.encode(stamp_ns, x, -y, *position_variance, speed_x, -speed_y, *speed_variance)


def encode_imu_data(stamp_ns: int, state: OdometryState) -> bytes:
    """Return ``imu/data``: roll is plane y's pitch angle, pitch is plane x's, yaw is zero."""
    (rate_x, rate_y), (rate_variance_x, rate_variance_y) = state.pitch_rate
    variance_x, variance_y = state.pitch.variance
    return _IMU.encode(
        stamp_ns,
        *body_orientation(state.pitch.value),
        variance_y,
        variance_x,
        rate_y,
        rate_x,
        rate_variance_y,
        rate_variance_x,
    )
