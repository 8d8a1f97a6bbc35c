"""rclpy for the nodes of this process."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import rclpy
from rclpy.impl.implementation_singleton import rclpy_implementation

from ballbot_ros.errors import BallbotError, one_line
from ballbot_ros.nodes.end_guard import guarded_end
from ballbot_ros.nodes.middleware import prepare_middleware, stay_local

RCLError = rclpy_implementation.RCLError


@contextmanager
def ros(log_level: str = 'WARN') -> Iterator[None]:
    """Provide rclpy for the nodes of this process; by default they discover only this machine.

    It raises BallbotError if ROS can't start here, for example without a folder for its logs.
    """
    stay_local()
    if rclpy.ok():
        yield
        return
    prepare_middleware()
    with guarded_end():
        try:
            rclpy.init(
                args=['--ros-args', '--log-level', log_level],
                signal_handler_options=rclpy.SignalHandlerOptions.NO,
            )
        except RuntimeError as error:
            raise BallbotError(one_line(error)) from None
        try:
            yield
        except RCLError as error:  # for example, a profile that Fast DDS refuses
            raise BallbotError(one_line(error)) from None
        finally:
            rclpy.try_shutdown()
