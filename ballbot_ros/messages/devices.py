"""The messages of the devices: the plant's true state (the truth), and the samples of it.

The functions that fill and read messages are like those of
:mod:`ballbot_ros.messages.conversions`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Generic, TypeAlias

from ballbot_ros.brick.units import (
    NO_DATA_CM,
    NO_ECHO_CM,
    degrees_to_radians,
    metres_to_sonar_cm,
    radians_to_degrees,
    sonar_cm_to_metres,
)
from ballbot_ros.messages.conversions import (
    MOTOR_NAMES,
    ball_position,
    body_rates,
    fill_header,
    motor_angles,
)
from ballbot_ros.messages.message_types import Imu, JointState, Range
from ballbot_ros.messages.topics import (
    GYRO_IMU,
    JOINT_STATES,
    PLANT_IMU,
    PLANT_JOINT_STATES,
    PLANT_ODOM,
    SONAR_RANGE,
    Topic,
)
from ballbot_ros.parameters import SonarParameters
from ballbot_ros.simulation.devices import (
    ENCODER_DEVICE,
    GYRO_DEVICE,
    SONAR_DEVICE,
    Device,
    Measured,
    P,
    Reading,
)

ULTRASOUND = 0


@dataclass(frozen=True)
class DeviceMessages(Generic[P, Measured, Reading]):
    """The input and output messages of a device's driver.

    Attributes
    ----------
    device : Device
    truth : Topic
        The plant's topic that the driver answers.
    measured : callable
        Returns the measured quantity from a message of `truth`.
    sample : Topic
        The topic of the device's samples.
    fill : callable
        Writes the stamp [ns] and the reading of a sample into a message.
    reading : callable
        Returns the reading from a sample. Raises ValueError if no such device can have sent it.
    describe : callable
        Writes the constant properties of the device into a message that `fill` completes.
    """

    device: Device[P, Measured, Reading]
    truth: Topic
    measured: Callable[[Any], Measured]
    sample: Topic
    fill: Callable[[Any, int, Reading], None]
    reading: Callable[[Any], Reading]
    describe: Callable[[Any, P], None] = lambda message, parameters: None


def fill_gyro(message: Imu, stamp_ns: int, counts: tuple[int, int]) -> None:
    """Write ``gyro``: the readings in rad/s, with their zero-rate offset."""
    fill_header(message.header, stamp_ns, 'base_link')
    rate = message.angular_velocity
    rate.y, rate.x = degrees_to_radians(counts[0]), degrees_to_radians(counts[1])
    message.orientation_covariance[0] = -1.0  # not provided
    message.linear_acceleration_covariance[0] = -1.0


def gyro_counts(message: Imu) -> tuple[int, int]:
    """Return the readings [deg/s + offset] of gyros S1 and S2 from ``gyro``."""
    return radians_to_degrees(message.angular_velocity.y), radians_to_degrees(
        message.angular_velocity.x
    )


def fill_encoders(message: JointState, stamp_ns: int, counts: tuple[int, int]) -> None:
    """Write ``joint_states``: whole degrees as rad."""
    fill_header(message.header, stamp_ns, '')
    message.name = MOTOR_NAMES
    message.position = [degrees_to_radians(counts[0]), degrees_to_radians(counts[1])]


def encoder_counts(message: JointState) -> tuple[int, int]:
    """Return the counts [deg] of motors B and C from ``joint_states``.

    It raises ValueError if the message has other joints.
    """
    if message.name != MOTOR_NAMES:
        raise ValueError(f'joints {message.name}, not {MOTOR_NAMES}')
    return radians_to_degrees(message.position[0]), radians_to_degrees(message.position[1])


def describe_sonar(message: Range, parameters: SonarParameters) -> None:
    """Write the sensor's properties to ``sonar``; a single ray has no field of view."""
    message.radiation_type = ULTRASOUND
    message.field_of_view = parameters.cone_angle
    message.min_range = 0.0
    message.max_range = sonar_cm_to_metres(NO_ECHO_CM - 1)


def fill_sonar(message: Range, stamp_ns: int, sonar_cm: int) -> None:
    """Write ``sonar``."""
    fill_header(message.header, stamp_ns, 'sonar')
    message.range = sonar_cm_to_metres(sonar_cm)


def sonar_range_cm(message: Range) -> int:
    """Return the reading [cm] from ``sonar``.

    It raises ValueError if the sensor's register can't hold it.
    """
    reading = metres_to_sonar_cm(message.range)
    if not NO_DATA_CM <= reading <= NO_ECHO_CM:
        raise ValueError(f'{reading} cm is not within 0 … {NO_ECHO_CM}')
    return reading


AnyDeviceMessages: TypeAlias = DeviceMessages[Any, Any, Any]
"""The messages of any device."""

DEVICE_MESSAGES: tuple[AnyDeviceMessages, ...] = (
    DeviceMessages(GYRO_DEVICE, PLANT_IMU, body_rates, GYRO_IMU, fill_gyro, gyro_counts),
    DeviceMessages(
        ENCODER_DEVICE,
        PLANT_JOINT_STATES,
        motor_angles,
        JOINT_STATES,
        fill_encoders,
        encoder_counts,
    ),
    DeviceMessages(
        SONAR_DEVICE,
        PLANT_ODOM,
        ball_position,
        SONAR_RANGE,
        fill_sonar,
        sonar_range_cm,
        describe_sonar,
    ),
)
