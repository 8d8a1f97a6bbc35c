"""Runs a node of the robot on rclpy's SingleThreadedExecutor.

``python -m benchmark.single_threaded NODE --ros-args …`` works like ``python -m ballbot_ros.nodes
NODE --ros-args …``, except for the executor.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence

import rclpy
from rclpy.executors import SingleThreadedExecutor

from ballbot_ros.nodes import base
from ballbot_ros.nodes.endpoints import IntraProcess
from ballbot_ros.nodes.registry import REGISTRY
from ballbot_ros.process import StopRequest


def spin(
    nodes: Sequence[base.AnyNode],
    done: rclpy.Future,
    stop: StopRequest | None = None,
    within: IntraProcess | None = None,
) -> None:
    """Run the callbacks of the nodes until `done`, or until a stop is requested."""
    executor = SingleThreadedExecutor()
    for node in nodes:
        executor.add_node(node)
    while not (done.done() or (stop and stop.signal)):
        executor.spin_until_future_complete(done, base.SIGNAL_PERIOD_S)


if __name__ == '__main__':
    base.spin = spin
    REGISTRY[sys.argv[1]].main()
