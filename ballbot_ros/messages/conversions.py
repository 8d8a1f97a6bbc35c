"""Exact conversions between messages and plain values.

A ``fill_…`` function writes into a message object of any library that uses the ROS field names, so
the nodes and the recording without ROS share it. Signs follow docs/frames.md: plane x is a rotation
about +y and a motion along +x of ``map``; plane y is a rotation about +x and a motion along -y.
"""

from __future__ import annotations

import math
from array import array
from collections.abc import Iterable
from typing import TYPE_CHECKING, SupportsFloat

import numpy as np

from ballbot_ros.brick.bluetooth import LogPacket
from ballbot_ros.brick.brick import Tone
from ballbot_ros.brick.units import degrees_to_radians, quantise
from ballbot_ros.controller.interface import PlaneEstimates
from ballbot_ros.messages.message_types import (
    BatteryState,
    Bytes,
    Clock,
    Header,
    Imu,
    JointState,
    Joy,
    OccupancyGridMessage,
    Odometry,
    Stamped,
    Time,
    Twist,
    Vector3Stamped,
    WrenchStamped,
)
from ballbot_ros.numerics.elementary import sine_cosine
from ballbot_ros.plant.ground_truth import GroundTruth, Pair, Push
from ballbot_ros.timing import SECOND_NS

if TYPE_CHECKING:
    from ballbot_ros.world.exports import OccupancyGrid

_DUTIES = frozenset(map(float, range(-100, 101)))

MOTOR_NAMES = ['motor_x', 'motor_y']
STATE_NAMES = ['theta_x', 'psi_x', 'theta_y', 'psi_y', 'theta_ref_x', 'theta_ref_y']

BATTERY_DISCHARGING = 2


def fill_time(message: Time, stamp_ns: int) -> None:
    """Write ``builtin_interfaces/Time``."""
    message.sec, message.nanosec = divmod(stamp_ns, SECOND_NS)


def time_ns(message: Time) -> int:
    """Return the nanoseconds of a ``builtin_interfaces/Time``."""
    return int(message.sec) * SECOND_NS + int(message.nanosec)


def stamp_ns(message: Stamped) -> int:
    """Return the stamp [ns] of a message that has a header."""
    return time_ns(message.header.stamp)


def fill_clock(message: Clock, now_ns: int) -> None:
    """Write ``rosgraph_msgs/Clock``."""
    fill_time(message.clock, now_ns)


def fill_header(message: Header, stamp_ns: int, frame_id: str) -> None:
    """Write ``std_msgs/Header``."""
    fill_time(message.stamp, stamp_ns)
    message.frame_id = frame_id


def fill_motors(message: JointState, truth: GroundTruth) -> None:
    """Write ``plant/joint_states``: true shaft angle, rate and torque."""
    fill_header(message.header, truth.stamp_ns, '')
    message.name = MOTOR_NAMES
    message.position = list(truth.motor_angle)
    message.velocity = list(truth.motor_rate)
    message.effort = list(truth.motor_torque)


def motor_angles(message: JointState) -> Pair:
    """Return the shaft angles [rad] of ``plant/joint_states``."""
    return message.position[0], message.position[1]


def fill_body(message: Imu, truth: GroundTruth) -> None:
    """Write ``plant/imu``: roll is plane y's pitch angle, pitch is plane x's, yaw is zero."""
    fill_header(message.header, truth.stamp_ns, 'base_link')
    q = message.orientation
    q.w, q.x, q.y, q.z = body_orientation(truth.psi)
    rate = message.angular_velocity
    rate.y, rate.x = truth.psi_rate
    message.linear_acceleration_covariance[0] = -1.0  # not provided


def body_orientation(psi: Pair) -> tuple[float, float, float, float]:
    """Return the orientation of ``base_link`` in ``map`` for the pitch angles `psi` [rad].

    A unit quaternion w, x, y, z: roll ψy, then pitch ψx, no yaw. :func:`pitch_angles` is its
    inverse.
    """
    sin_x, cos_x = sine_cosine(psi[0] / 2.0)
    sin_y, cos_y = sine_cosine(psi[1] / 2.0)
    return cos_x * cos_y, cos_x * sin_y, sin_x * cos_y, -sin_x * sin_y


def body_rates(message: Imu) -> Pair:
    """Return the pitch rates [rad/s] of planes x and y from ``plant/imu``."""
    return message.angular_velocity.y, message.angular_velocity.x


def body_pitch(message: Imu) -> Pair:
    """Return the pitch angles [rad] of planes x and y from ``plant/imu``."""
    q = message.orientation
    return pitch_angles(q.w, q.x, q.y, q.z)


def pitch_angles(w: float, x: float, y: float, z: float) -> Pair:
    """Return the pitch angles [rad] of planes x and y of an orientation."""
    psi_x = 2.0 * math.atan2(math.hypot(y, z), math.hypot(w, x))
    psi_y = 2.0 * math.atan2(math.hypot(x, z), math.hypot(w, y))
    return math.copysign(psi_x, y), math.copysign(psi_y, x)


def fill_odometry(message: Odometry, truth: GroundTruth, ball_radius: float) -> None:
    """Write ``plant/odom``: pose and twist of the ball's centre in ``map``."""
    fill_header(message.header, truth.stamp_ns, 'map')
    message.child_frame_id = 'ball'
    point = message.pose.pose.position
    point.x, point.y, point.z = truth.position[0], -truth.position[1], ball_radius
    speed = message.twist.twist.linear
    speed.x, speed.y = truth.velocity[0], -truth.velocity[1]


def ball_position(message: Odometry) -> Pair:
    """Return the ball's position [m] on planes x and y from ``plant/odom``."""
    return message.pose.pose.position.x, -message.pose.pose.position.y


def fill_battery(message: BatteryState, truth: GroundTruth) -> None:
    """Write ``battery_state``."""
    fill_header(message.header, truth.stamp_ns, 'base_link')
    message.voltage = truth.battery_voltage
    for unknown in (
        'temperature',
        'current',
        'charge',
        'capacity',
        'design_capacity',
        'percentage',
    ):
        setattr(message, unknown, math.nan)
    message.power_supply_status = BATTERY_DISCHARGING
    message.present = True


def fill_map(message: OccupancyGridMessage, stamp_ns: int, grid: OccupancyGrid) -> None:
    """Write ``map``: the walls of the floor."""
    fill_header(message.header, stamp_ns, 'map')
    fill_time(message.info.map_load_time, stamp_ns)
    message.info.resolution = grid.resolution
    message.info.width, message.info.height = grid.width, grid.height
    corner = message.info.origin.position
    corner.x, corner.y = grid.origin
    message.data = array('b', grid.cells.tobytes())


def map_grid(message: OccupancyGridMessage) -> OccupancyGrid:
    """Return the occupancy grid of ``map``."""
    # Imported here, so that nodes without a map start faster.
    from ballbot_ros.world.exports import OccupancyGrid

    info = message.info
    cells = np.asarray(message.data, np.int8).reshape(info.height, info.width)
    corner = info.origin.position
    return OccupancyGrid(info.width, info.height, info.resolution, (corner.x, corner.y), cells)


def fill_sticks(message: Joy, stamp_ns: int, sticks: tuple[int, int], source: str) -> None:
    """Write ``gamepad``: left stick vertical and right stick horizontal, each n/100.

    Its frame_id names the input in command.
    """
    fill_header(message.header, stamp_ns, source)
    message.axes = [sticks[0] / 100.0, sticks[1] / 100.0]


def stick_values(message: Joy) -> tuple[int, int]:
    """Return the sticks from ``gamepad``, as the integers of the Bluetooth packet."""
    return quantise(message.axes[0] * 100.0), quantise(message.axes[1] * 100.0)


def planar_velocity(twist: Twist) -> Pair:
    """Return the velocity [m/s] forward and to the left from a ``geometry_msgs/Twist``."""
    return twist.linear.x, twist.linear.y


def log_packet(message: Bytes) -> LogPacket:
    """Return the packet in ``bluetooth/tx``; PacketError if it is malformed."""
    return LogPacket.decode(bytes(message.data))


def fill_duty(message: Vector3Stamped, stamp_ns: int, duty: tuple[int, int]) -> None:
    """Write ``motor_duty``."""
    fill_header(message.header, stamp_ns, '')
    message.vector.x, message.vector.y = float(duty[0]), float(duty[1])


def duty_values(message: Vector3Stamped) -> tuple[int, int] | None:
    """Return the duties [%] from ``motor_duty``; None unless they are whole and within ±100."""
    x, y = message.vector.x, message.vector.y
    if not (x in _DUTIES and y in _DUTIES):
        return None
    return int(x), int(y)


def fill_controller_state(
    message: JointState, stamp_ns: int, x: PlaneEstimates, y: PlaneEstimates
) -> None:
    """Write ``controller/state``: the controller's estimates and references in SI."""
    fill_header(message.header, stamp_ns, '')
    message.name = STATE_NAMES
    message.position = _radians((x.theta, x.psi, y.theta, y.psi, x.theta_ref, y.theta_ref))
    message.velocity = _radians(
        (x.theta_dot, x.psi_dot, y.theta_dot, y.psi_dot, x.theta_ref_dot, y.theta_ref_dot)
    )


def _radians(angles: Iterable[SupportsFloat]) -> list[float]:
    return [degrees_to_radians(float(angle)) for angle in angles]


def fill_log(message: Bytes, packet: LogPacket) -> None:
    """Write ``bluetooth/tx``: the packet's 32 bytes."""
    message.data = packet.encode()


def fill_tone(message: Vector3Stamped, stamp_ns: int, tone: Tone) -> None:
    """Write ``sound``: frequency [Hz], duration [ms], volume [%]."""
    fill_header(message.header, stamp_ns, '')
    sound = message.vector
    sound.x, sound.y, sound.z = map(float, tone)


def tone_of(message: Vector3Stamped) -> Tone:
    """Return the tone of ``sound``."""
    return Tone(*(round(value) for value in (message.vector.x, message.vector.y, message.vector.z)))


def fill_accepted_push(
    message: WrenchStamped, stamp_ns: int, push: Push, number: int, *, acts: bool
) -> None:
    """Write ``plant/accepted_push``: the wrench of push `number` from the stamp on.

    It is zero unless the push acts.
    """
    fill_header(message.header, stamp_ns, f'push {number}')
    force, torque = message.wrench.force, message.wrench.torque
    force.x, force.y = (push.force[0], -push.force[1]) if acts else (0.0, 0.0)
    torque.y, torque.x = push.torque if acts else (0.0, 0.0)


def fill_push(message: WrenchStamped, stamp_ns: int, force: Pair) -> None:
    """Write ``plant/push``: a force [N] in plane signs."""
    fill_header(message.header, stamp_ns, 'base_link')
    message.wrench.force.x, message.wrench.force.y = force[0], -force[1]


def fill_joy(message: Joy, stamp_ns: int, sticks: Pair) -> None:
    """Write ``viewer/joy``: forward and rightward, each −1 ... 1, as axes 1 and 2 of ``joy``."""
    fill_header(message.header, stamp_ns, '')
    message.axes = [0.0, sticks[0], -sticks[1], 0.0]


def push_forces(message: WrenchStamped) -> tuple[Pair, Pair]:
    """Return force [N] and torque [N·m] of ``plant/push`` in plane signs."""
    force, torque = message.wrench.force, message.wrench.torque
    return (force.x, -force.y), (torque.y, torque.x)
