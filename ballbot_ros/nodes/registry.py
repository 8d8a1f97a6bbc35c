"""The registry of the nodes: class and module of each, imported on demand."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from importlib import import_module
from types import ModuleType
from typing import TYPE_CHECKING

from ballbot_ros.parameters import (
    DEVICES,
    BrickLinkParameters,
    ControllerParameters,
    GamepadParameters,
    NodeParameters,
    PlantParameters,
    PlayerParameters,
    RecorderParameters,
    ViewerParameters,
    VisualizerParameters,
)

if TYPE_CHECKING:
    from ballbot_ros.nodes.base import AnyNode


@dataclass(frozen=True)
class NodeEntry:
    """A node that can be started as a program.

    The class of its parameters has its name. The module is one of :mod:`ballbot_ros.nodes`.
    """

    parameters: type[NodeParameters]
    module: str
    class_name: str

    @property
    def maker(self) -> Callable[..., AnyNode]:
        """Function that creates the node, with given parameter values or those from ROS."""
        found = getattr(self.load(), self.class_name)
        # One class serves all devices.
        return partial(found, self.parameters) if self.parameters in DEVICES else found

    @property
    def main(self) -> Callable[[], int]:
        """Function that runs the node as a program, and returns its exit status."""
        from ballbot_ros.nodes.base import run_node  # needs rclpy

        return partial(run_node, self.maker)

    def load(self) -> ModuleType:
        """Import the module."""
        return import_module(f'ballbot_ros.nodes.{self.module}')


_ENTRIES = (
    NodeEntry(PlantParameters, 'plant_sim', 'PlantSim'),
    *(NodeEntry(each, 'device_driver', 'DeviceDriver') for each in DEVICES),
    NodeEntry(ControllerParameters, 'controller', 'ControllerNode'),
    NodeEntry(GamepadParameters, 'gamepad_teleop', 'GamepadTeleop'),
    NodeEntry(RecorderParameters, 'recorder', 'Recorder'),
    NodeEntry(PlayerParameters, 'player', 'Player'),
    NodeEntry(ViewerParameters, 'viewer', 'Viewer'),
    NodeEntry(VisualizerParameters, 'robot_visualizer', 'RobotVisualizer'),
    NodeEntry(BrickLinkParameters, 'brick_link', 'BrickLink'),
)

REGISTRY = {each.parameters.node: each for each in _ENTRIES}
"""The nodes by name."""


def make_node(parameters: NodeParameters) -> AnyNode:
    """Create the node that these parameters belong to; their class determines which node."""
    return REGISTRY[parameters.node].maker(parameters)
