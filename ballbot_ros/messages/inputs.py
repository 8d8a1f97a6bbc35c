"""The controller's inputs: which topics they are, and what the brick reads from each."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from ballbot_ros.brick.battery_monitor import battery_mv
from ballbot_ros.brick.brick import DeviceInputs
from ballbot_ros.messages.conversions import (
    encoder_counts,
    gyro_counts,
    sonar_reading,
    stick_values,
)
from ballbot_ros.messages.topics import (
    BATTERY_STATE,
    GAMEPAD_JOY,
    GYRO_IMU,
    JOINT_STATES,
    SONAR_RANGE,
    Topic,
)

INPUTS: dict[Topic, Callable[[Any], Any]] = {
    GYRO_IMU: gyro_counts,
    JOINT_STATES: encoder_counts,
    SONAR_RANGE: sonar_reading,
    GAMEPAD_JOY: stick_values,
    BATTERY_STATE: lambda message: battery_mv(message.voltage),
}


def device_inputs(sample: Callable[[Topic], Any]) -> DeviceInputs:
    """Return the inputs of a tick from the `sample` of each topic, None where there is none."""
    return DeviceInputs(
        gyro=sample(GYRO_IMU),
        revolutions=sample(JOINT_STATES),
        sonar_cm=sample(SONAR_RANGE),
        battery_mv=sample(BATTERY_STATE),
        sticks=sample(GAMEPAD_JOY),
    )
