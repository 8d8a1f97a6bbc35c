"""A driver that leaves does not take its last sample with it."""

from types import SimpleNamespace

import pytest

pytest.importorskip('rclpy')

from stubs import bare

from ballbot_ros.nodes.device_driver import DeviceDriver
from ballbot_ros.nodes.gamepad_teleop import GamepadTeleop
from ballbot_ros.recording.messages.topics import GAMEPAD_JOY, GYRO_IMU


def test_a_driver_waits_until_its_last_sample_has_reached_the_recorder():
    """The recorder, too, may be the last to get what the others have answered."""
    flushed = []
    messages = SimpleNamespace(sample=GYRO_IMU)
    DeviceDriver.close(bare(DeviceDriver, _messages=messages, flush=flushed.append))
    close = SimpleNamespace(close=lambda: None)
    GamepadTeleop.close(
        bare(GamepadTeleop, terminal=None, _inputs=close, _log=None, flush=flushed.append)
    )
    assert flushed == [GYRO_IMU, GAMEPAD_JOY]
