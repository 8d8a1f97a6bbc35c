"""The nodes as programs, which a signal ends quietly from their first import on."""

from __future__ import annotations

import sys
from functools import partial
from importlib import import_module

from ballbot_ros.standard_streams import open_standard_streams
from ballbot_ros.stop_request import StopRequest


def start(node: str) -> None:
    """Import a node's module and run it; a signal that comes meanwhile ends the program after it.

    Parameters
    ----------
    node : str
        Name of the module.
    """
    open_standard_streams()
    with StopRequest() as stop:
        module = import_module(f'ballbot_ros.nodes.{node}')
        if not stop.signal:
            module.main()


plant_sim = partial(start, 'plant_sim')
gyro_driver = partial(start, 'gyro_driver')
encoder_driver = partial(start, 'encoder_driver')
sonar_driver = partial(start, 'sonar_driver')
controller = partial(start, 'controller')
gamepad_teleop = partial(start, 'gamepad_teleop')
recorder = partial(start, 'recorder')
player = partial(start, 'player')
viewer = partial(start, 'viewer')
robot_visualizer = partial(start, 'robot_visualizer')


def main() -> None:
    """Run the node that the first argument names."""
    names = [name for name, value in globals().items() if isinstance(value, partial)]
    if len(sys.argv) < 2 or sys.argv[1] not in names:
        given = repr(sys.argv[1]) if len(sys.argv) > 1 else 'nothing'
        print(f'error: {given} is no node; there are {", ".join(names)}', file=sys.stderr)
        sys.exit(2)
    start(sys.argv.pop(1))
