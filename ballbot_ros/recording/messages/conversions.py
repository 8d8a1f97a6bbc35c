"""Exact conversions between messages and plain values.

``encode_…`` returns a message as CDR, for the nodes and for recordings without ROS alike, and
``decode_…`` reads one. The other functions read a message object of any library that uses the ROS
field names. Signs follow docs/frames.md: plane x is a rotation about +y and a motion along +x of
``map``; plane y is a rotation about +x and a motion along -y.

A run that does not complete ends with a motor stop, from the plant and from the controller if they
are still alive. Its frame_id distinguishes it from the answers to ticks, whose frame_id is empty.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable
from functools import cache, lru_cache
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ballbot_ros.controllers.interface import PlaneEstimates
from ballbot_ros.engine.plant_tick import LATEST_DUTY, STEP_S
from ballbot_ros.parameters.timing import SECOND_NS
from ballbot_ros.recording.batch import Batch, Rows
from ballbot_ros.recording.messages import topics
from ballbot_ros.recording.messages.raw import MessageLayout, Messages, Stamps, elements
from ballbot_ros.recording.schemas import (
    Bytes,
    Header,
    Imu,
    JointState,
    Joy,
    OccupancyGridMessage,
    Odometry,
    Time,
    Twist,
    Vector3Stamped,
    WrenchStamped,
    encoder,
    new_message,
)
from ballbot_ros.robot.arithmetic import Floats, sine_cosine, sines_cosines
from ballbot_ros.robot.brick.bluetooth import LogPacket
from ballbot_ros.robot.brick.brick import MotorDuty, Tone
from ballbot_ros.robot.brick.sensors import RADIANS_PER_DEGREE, battery_mv, quantise
from ballbot_ros.robot.plant.ground_truth import GroundTruth, Pair, Push

if TYPE_CHECKING:
    from ballbot_ros.robot.world.floor_map import OccupancyGrid

_DUTIES = frozenset(map(float, range(-100, 101)))

MOTOR_NAMES = ['motor_x', 'motor_y']
STATE_NAMES = ['theta_x', 'psi_x', 'theta_y', 'psi_y', 'theta_ref_x', 'theta_ref_y']

_BATTERY_DISCHARGING = 2
NOT_PROVIDED = -1.0
"""The first element of the covariance of a quantity that an Imu message does not provide."""

_UNKNOWN = ('temperature', 'current', 'charge', 'capacity', 'design_capacity', 'percentage')

_CLOCK = MessageLayout(topics.CLOCK.type_name)
_MOTORS = MessageLayout(
    topics.PLANT_JOINT_STATES.type_name,
    [*elements('position', 2), *elements('velocity', 2), *elements('effort', 2)],
    {'name': MOTOR_NAMES, 'position': [0.0] * 2, 'velocity': [0.0] * 2, 'effort': [0.0] * 2},
)
_BODY = MessageLayout(
    topics.PLANT_IMU.type_name,
    [
        'angular_velocity.y', 'angular_velocity.x',
        'orientation.w', 'orientation.x', 'orientation.y', 'orientation.z',
    ],
    {'header.frame_id': 'base_link', 'linear_acceleration_covariance[0]': NOT_PROVIDED},
)  # fmt: skip
_ODOMETRY = MessageLayout(
    topics.PLANT_ODOM.type_name,
    [
        'pose.pose.position.x', 'pose.pose.position.y', 'pose.pose.position.z',
        'twist.twist.linear.x', 'twist.twist.linear.y',
    ],
    {'header.frame_id': 'map', 'child_frame_id': 'ball'},
)  # fmt: skip
_BATTERY = MessageLayout(
    topics.BATTERY_STATE.type_name,
    ['voltage'],
    {
        'header.frame_id': 'base_link',
        'power_supply_status': _BATTERY_DISCHARGING,
        'present': True,
        **dict.fromkeys(_UNKNOWN, math.nan),
    },
)
_DUTY = MessageLayout(topics.MOTOR_DUTY.type_name, ['vector.x', 'vector.y', 'vector.z'])
_STATE = MessageLayout(
    topics.CONTROLLER_STATE.type_name,
    [*elements('position', 6), *elements('velocity', 6)],
    {'name': STATE_NAMES, 'position': [0.0] * 6, 'velocity': [0.0] * 6},
)
_TONE = MessageLayout(topics.SOUND.type_name, ['vector.x', 'vector.y', 'vector.z'])


@lru_cache(16)
def _sticks(source: str) -> MessageLayout:
    return MessageLayout(
        topics.GAMEPAD_JOY.type_name,
        elements('axes', 2),
        {'header.frame_id': source, 'axes': [0.0] * 2},
    )


def fill_time(message: Time, stamp_ns: int) -> None:
    """Write ``builtin_interfaces/Time``."""
    message.sec, message.nanosec = divmod(stamp_ns, SECOND_NS)


def time_ns(message: Time) -> int:
    """Return the nanoseconds of a ``builtin_interfaces/Time``."""
    return int(message.sec) * SECOND_NS + int(message.nanosec)


def stamp_ns(message: Any) -> int:
    """Return the stamp [ns] of a message that has a header."""
    return time_ns(message.header.stamp)


def fill_header(message: Header, stamp_ns: int, frame_id: str) -> None:
    """Write ``std_msgs/Header``."""
    fill_time(message.stamp, stamp_ns)
    message.frame_id = frame_id


def encode_header(stamp_ns: int, frame_id: str = '') -> bytes:
    """Return ``std_msgs/Header``."""
    message = new_message(topics.RUN.type_name)
    fill_header(message, stamp_ns, frame_id)
    return encoder(topics.RUN.type_name)(message)


def encode_clock(now_ns: int) -> bytes:
    """Return ``/clock``."""
    return _CLOCK.encode(now_ns)


def encode_motors(truth: GroundTruth) -> bytes:
    """Return ``plant/joint_states``: true shaft angle, rate and torque."""
    return _MOTORS.encode(
        truth.stamp_ns, *truth.motor_angle, *truth.motor_rate, *truth.motor_torque
    )


def decode_motor_angles(data: bytes) -> Pair:
    """Return the shaft angles [rad] of ``plant/joint_states``."""
    angle_x, angle_y, *_ = _MOTORS.decode(data)
    return angle_x, angle_y


def encode_body(truth: GroundTruth) -> bytes:
    """Return ``plant/imu``: roll is plane y's pitch angle, pitch is plane x's, yaw is zero."""
    return _BODY.encode(truth.stamp_ns, *truth.psi_rate, *body_orientation(truth.psi))


def decode_body_rates(data: bytes) -> Pair:
    """Return the pitch rates [rad/s] of planes x and y from ``plant/imu``."""
    rate_x, rate_y, *_ = _BODY.decode(data)
    return rate_x, rate_y


def decode_body_pitch(data: bytes) -> Pair:
    """Return the pitch angles [rad] of planes x and y from ``plant/imu``."""
    _, _, w, x, y, z = _BODY.decode(data)
    return pitch_angles(w, x, y, z)


def body_orientation(psi: Any) -> tuple[Any, Any, Any, Any]:
    """Return the orientation of ``base_link`` in ``map`` for the pitch angles `psi` [rad].

    A unit quaternion w, x, y, z: roll ψy, then pitch ψx, no yaw. :func:`pitch_angles` is its
    inverse. The angles may be columns.
    """
    psi_x, psi_y = psi
    both: Callable[[Any], Any] = sines_cosines if isinstance(psi_x, np.ndarray) else sine_cosine
    (sin_x, cos_x), (sin_y, cos_y) = both(psi_x / 2.0), both(psi_y / 2.0)
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


def pitches(w: Floats, x: Floats, y: Floats, z: Floats) -> Floats:
    """Return :func:`pitch_angles` of many orientations, shape (2, n)."""
    columns = (each.tolist() for each in (w, x, y, z))
    return np.array(list(map(pitch_angles, *columns))).reshape(-1, 2).T


def encode_odometry(truth: GroundTruth, ball_radius: float) -> bytes:
    """Return ``plant/odom``: pose and twist of the ball's centre in ``map``."""
    (x, y), (speed_x, speed_y) = truth.position, truth.velocity
    return _ODOMETRY.encode(truth.stamp_ns, x, -y, ball_radius, speed_x, -speed_y)


def decode_ball_position(data: bytes) -> Pair:
    """Return the ball's position [m] on planes x and y from ``plant/odom``."""
    x, y, *_ = _ODOMETRY.decode(data)
    return x, -y


def odometry_position(message: Odometry) -> Pair:
    """Return the ball's position [m] on planes x and y from ``plant/odom``."""
    return message.pose.pose.position.x, -message.pose.pose.position.y


def ball_velocity(message: Odometry) -> Pair:
    """Return the ball's velocity [m/s] on planes x and y from ``plant/odom``."""
    velocity = message.twist.twist.linear
    return velocity.x, -velocity.y


def encode_battery(stamp_ns: int, volts: float) -> bytes:
    """Return ``battery_state`` for a voltage [V]."""
    return _BATTERY.encode(stamp_ns, volts)


def decode_battery_mv(data: bytes) -> int:
    """Return the brick's reading [mV] of the voltage in ``battery_state``."""
    (voltage,) = _BATTERY.decode(data)
    return battery_mv(voltage)


def encode_wall_hit(*, wall_hit: bool) -> bytes:
    """Return ``wall_hit``."""
    return _encode_data(topics.WALL_HIT.type_name, wall_hit)


def encode_map(stamp_ns: int, grid: OccupancyGrid) -> bytes:
    """Return ``map``: the walls of the floor."""
    message = new_message(topics.MAP.type_name)
    fill_header(message.header, stamp_ns, 'map')
    fill_time(message.info.map_load_time, stamp_ns)
    message.info.resolution = grid.resolution
    message.info.width, message.info.height = grid.width, grid.height
    corner = message.info.origin.position
    corner.x, corner.y = grid.origin
    message.data = grid.cells.ravel()
    return encoder(topics.MAP.type_name)(message)


def map_grid(message: OccupancyGridMessage) -> OccupancyGrid:
    """Return the occupancy grid of ``map``."""
    # Imported here, so that nodes without a map start faster.
    from ballbot_ros.robot.world.floor_map import OccupancyGrid

    info = message.info
    cells = np.asarray(message.data, np.int8).reshape(info.height, info.width)
    corner = info.origin.position
    return OccupancyGrid(info.width, info.height, info.resolution, (corner.x, corner.y), cells)


def encode_sticks(stamp_ns: int, sticks: tuple[int, int], source: str) -> bytes:
    """Return ``gamepad``: left stick vertical and right stick horizontal, each n/100.

    Its frame_id names the input in command.
    """
    return _sticks(source).encode(stamp_ns, sticks[0] / 100.0, sticks[1] / 100.0)


def decode_sticks(data: bytes) -> tuple[int, int]:
    """Return the sticks of ``gamepad``, as the integers of the Bluetooth packet."""
    vertical, horizontal = _sticks(topics.SCENARIO).decode(data)
    return quantise(vertical * 100.0), quantise(horizontal * 100.0)


def stick_deflection(message: Joy) -> Pair:
    """Return the sticks of ``gamepad`` forward and rightward, each -1 ... 1."""
    return -message.axes[0], message.axes[1]


def planar_velocity(twist: Twist) -> Pair:
    """Return the velocity [m/s] forward and to the left from a ``geometry_msgs/Twist``."""
    return twist.linear.x, twist.linear.y


def encode_duty(stamp_ns: int, duty: tuple[int, int], delay_ns: int = 0) -> bytes:
    """Return ``motor_duty``: the duties [%], and the time until they take effect [s]."""
    return _DUTY.encode(stamp_ns, *duty, delay_ns / SECOND_NS)


def decode_real_duty(data: bytes) -> tuple[float, float]:
    """Return the numbers in ``motor_duty``, which are duties [%] if they are whole."""
    x, y, _ = _DUTY.decode(data)
    return x, y


def decode_duty(data: bytes) -> MotorDuty | None:
    """Return the content of ``motor_duty``; None unless it is allowed.

    The duties are whole numbers within ±100, and the delay is not longer than
    :data:`~ballbot_ros.engine.plant_tick.LATEST_DUTY` steps.
    """
    x, y, delay_s = _DUTY.decode(data)
    if x not in _DUTIES or y not in _DUTIES or not 0.0 <= delay_s <= LATEST_DUTY * STEP_S:
        return None
    return MotorDuty(int(x), int(y), round(delay_s * SECOND_NS))


def encode_controller_state(stamp_ns: int, x: PlaneEstimates, y: PlaneEstimates) -> bytes:
    """Return ``controller/state``: the controller's estimates and references in SI."""
    degrees = _degrees(x, y)
    return _STATE.encode(stamp_ns, *[float(angle) * RADIANS_PER_DEGREE for angle in degrees])


def _degrees(x: Any, y: Any) -> tuple[Any, ...]:
    return (
        x.theta, x.psi, y.theta, y.psi, x.theta_ref, y.theta_ref,
        x.theta_dot, x.psi_dot, y.theta_dot, y.psi_dot, x.theta_ref_dot, y.theta_ref_dot,
    )  # fmt: skip


def encode_controller_states(stamps_ns: Stamps, x: object, y: object) -> Messages:
    """Return :func:`encode_controller_state` of each row of estimates in columns."""
    degrees = (np.asarray(angle, np.float64) for angle in _degrees(x, y))
    return _STATE.encode(stamps_ns, *(angle * RADIANS_PER_DEGREE for angle in degrees))


class ControllerState(NamedTuple):
    """What ``controller/state`` says of planes x and y; NaN where the controller does not say it.

    Attributes
    ----------
    theta, psi : tuple of float
        Estimated angles of ball and body [rad].
    theta_ref, theta_ref_dot : tuple of float
        Reference of the ball angle [rad], and its rate [rad/s].
    """

    theta: Pair
    psi: Pair
    theta_ref: Pair
    theta_ref_dot: Pair


_NO_PAIR = math.nan, math.nan
NO_CONTROLLER_STATE = ControllerState(_NO_PAIR, _NO_PAIR, _NO_PAIR, _NO_PAIR)


def controller_state(message: JointState) -> ControllerState:
    """Return the angles in ``controller/state``, whose references may be missing."""
    position, rate = message.position, message.velocity
    return ControllerState(
        theta=(position[0], position[2]),
        psi=(position[1], position[3]),
        theta_ref=(position[4], position[5]) if len(position) >= len(STATE_NAMES) else _NO_PAIR,
        theta_ref_dot=(rate[4], rate[5]) if len(rate) >= len(STATE_NAMES) else _NO_PAIR,
    )


def encode_text(text: str) -> bytes:
    """Return ``std_msgs/String``, such as ``operating_state`` and ``lcd``."""
    return _encode_data(topics.LCD.type_name, text)


def encode_log(packet: LogPacket) -> bytes:
    """Return ``bluetooth/tx``: the packet's 32 bytes."""
    data = packet.encode()
    return _log_head(len(data)) + data


@cache
def _log_head(length: int) -> bytes:
    """Return what precedes the bytes of a packet, which end the message."""
    return _encode_data(topics.BLUETOOTH_TX.type_name, bytes(length))[:-length]


def log_packet(message: Bytes) -> LogPacket:
    """Return the packet in ``bluetooth/tx``; PacketError if it is malformed."""
    return LogPacket.decode(bytes(message.data))


def encode_tone(stamp_ns: int, tone: Tone) -> bytes:
    """Return ``sound``: frequency [Hz], duration [ms], volume [%]."""
    return _TONE.encode(stamp_ns, *tone)


def sound_tone(message: Vector3Stamped) -> Tone:
    """Return the tone of ``sound``."""
    return Tone(*(round(value) for value in (message.vector.x, message.vector.y, message.vector.z)))


def encode_accepted_push(stamp_ns: int, push: Push, number: int, *, acts: bool) -> bytes:
    """Return ``plant/accepted_push``: the wrench of push `number` from the stamp on.

    It is zero unless the push acts.
    """
    force, torque = (push.force, push.torque) if acts else ((0.0, -0.0), (0.0, 0.0))
    return _encode_push(stamp_ns, f'push {number}', force, torque)


def encode_push(stamp_ns: int, force: Pair) -> bytes:
    """Return ``plant/push``: a force [N] in plane signs."""
    return _encode_push(stamp_ns, 'base_link', force, (0.0, 0.0))


def _encode_push(stamp_ns: int, frame_id: str, force: Pair, torque: Pair) -> bytes:
    message = new_message(topics.PUSH.type_name)
    fill_header(message.header, stamp_ns, frame_id)
    wrench = message.wrench
    wrench.force.x, wrench.force.y = force[0], -force[1]
    wrench.torque.y, wrench.torque.x = torque
    return encoder(topics.PUSH.type_name)(message)


def push_forces(message: WrenchStamped) -> tuple[Pair, Pair]:
    """Return force [N] and torque [N·m] of ``plant/push`` in plane signs."""
    force, torque = message.wrench.force, message.wrench.torque
    return (force.x, -force.y), (torque.y, torque.x)


def encode_joy(stamp_ns: int, sticks: Pair) -> bytes:
    """Return ``viewer/joy``: forward and rightward, each −1 ... 1, as axes 1 and 2 of ``joy``."""
    message = new_message(topics.GAMEPAD_JOY.type_name)
    fill_header(message.header, stamp_ns, '')
    message.axes = [0.0, sticks[0], -sticks[1], 0.0]
    return encoder(topics.GAMEPAD_JOY.type_name)(message)


def _encode_data(type_name: str, data: object) -> bytes:
    """Return a message of ``std_msgs`` whose content is its field ``data``."""
    message = new_message(type_name)
    message.data = data
    return encoder(type_name)(message)


FRAME_ID = 'stop'

_LAYOUT = MessageLayout(topics.MOTOR_DUTY.type_name, constants={'header.frame_id': FRAME_ID})

# In CDR, the frame_id follows four bytes of encoding and a stamp of eight bytes.
_BEGIN = 12
_ENCODED = struct.pack(f'<I{len(FRAME_ID) + 1}s', len(FRAME_ID) + 1, FRAME_ID.encode())


def encode_stop(stamp_ns: int) -> bytes:
    """Return a motor stop: from `stamp_ns` on the motors are off."""
    return _LAYOUT.encode(stamp_ns)


def is_stop(data: bytes) -> bool:
    """Return whether a serialised ``motor_duty`` is a motor stop."""
    return data[_BEGIN : _BEGIN + len(_ENCODED)] == _ENCODED


def are_stops(batch: Batch, rows: Rows) -> NDArray[np.bool_]:
    """Return which of some recorded ``motor_duty`` are motor stops."""
    return batch.match_bytes(rows, _BEGIN, _ENCODED)
