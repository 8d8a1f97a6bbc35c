"""Launches the whole graph and, on request, the recorder and RViz."""

import sys
from difflib import get_close_matches
from pathlib import Path

import yaml
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction, RegisterEventHandler, Shutdown
from launch.event_handlers import OnProcessExit, OnShutdown
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackagePrefix

from ballbot_ros.files import share_directory, temporary_folder
from ballbot_ros.parameters import (
    ALL_NODES,
    PLANT,
    VISUALIZER,
    ParameterSet,
)
from ballbot_ros.parameters.files import write_parameter_file
from ballbot_ros.recording.messages.topics import MAP, MARKERS, PLANT_ODOM, ROBOT_DESCRIPTION
from ballbot_ros.run.graph import graph_parameters
from ballbot_ros.run.spec import RunOptions, RunSpec

ARGUMENTS = {
    'scenario': ('', 'name or file of a scenario; empty: balance until stopped'),
    'params_file': ('', 'parameter file that overrides the scenario'),
    'controller': ('', 'controller: a name, FILE.py:Class or package.module:Class; empty: as set'),
    'external': ('', 'roles, separated by commas, that nodes of yours take; empty: none'),
    'real_time_factor': ('', '1: real time, 0: as fast as possible; empty: as in the files, or 1'),
    'record': ('false', 'true: record the run'),
    'output': ('', 'recording to write; empty: a new one under runs/'),
    'namespace': ('', 'namespace of the nodes'),
    'rviz': ('false', 'true: show the robot in RViz'),
}
SWITCHES = ('record', 'rviz')
ROS2_LAUNCH_ARGUMENTS = ('launch-prefix', 'launch-prefix-filter')
"""Arguments that `ros2 launch` adds by itself."""


class LaunchError(RuntimeError):
    """Error that ends the launch with a nonzero status."""


def check_names(context):
    """Refuse misspelt arguments, if this is the launched file.

    When another launch file includes this one, the arguments may belong to that file.
    """
    if Path(__file__).name not in {Path(word).name for word in sys.argv}:
        return
    for word in context.argv:
        name = word.partition(':=')[0]
        if name not in ARGUMENTS and name not in ROS2_LAUNCH_ARGUMENTS:
            close = get_close_matches(name, ARGUMENTS)
            hint = f'did you mean {close[0]}?' if close else f'known: {", ".join(ARGUMENTS)}'
            raise LaunchError(f'no launch argument {name!r}; {hint}')


class End:
    """Ends the launch when the run ends, with the result of the run.

    The plant ends with the run. A node that refuses to start ends with status 2, and one that
    fails with 1; the plant then notices that it is missing and gives the details. A killed node
    may be started again.
    """

    def __init__(self, nodes):
        self._names = {node: name for name, node in nodes.items()}
        self._failure = ''

    def __call__(self, event, context):
        """Return the actions that follow the end of a process, or raise LaunchError."""
        name, status = self._names.get(event.action), event.returncode
        if name is None:
            return None
        if status > 0 or (status < 0 and name == PLANT):
            self._failure = self._failure or f'{name} ended with status {status}'
        if self._failure and (name == PLANT or status == 2 or context.is_shutdown):
            failure, self._failure = self._failure, ''
            raise LaunchError(failure)
        return [Shutdown(reason='the run has ended')] if name == PLANT else None


def launch_graph(context):
    """Return the nodes, with the parameters of the scenario and of the arguments."""
    check_names(context)
    given = {name: LaunchConfiguration(name).perform(context) for name in ARGUMENTS}
    record, show = given['record'] == 'true', given['rviz'] == 'true'
    if show:
        # If rviz2 is missing, end the launch here, before any process has started.
        FindPackagePrefix('rviz2').perform(context)
    factor = None
    if given['real_time_factor']:
        factor = yaml.safe_load(given['real_time_factor'])
        ParameterSet().set(PLANT, 'real_time_factor', factor, 'real_time_factor:=')
    options = RunOptions(
        parameter_file=Path(given['params_file']) if given['params_file'] else None,
        real_time_factor=factor,
        default_real_time_factor=None,
        controller=given['controller'] or None,
        external=[role for role in given['external'].split(',') if role],
        record=record,
    )
    spec = RunSpec.compose(given['scenario'] or None, options)
    scratch = temporary_folder()
    folder = Path(scratch.name)
    recording = Path(given['output']) if given['output'] else None
    parameters = graph_parameters(spec, recording, folder)
    write_parameter_file(folder / 'parameters.yaml', parameters, ALL_NODES)
    nodes = {
        name: Node(
            package='ballbot_ros',
            executable=name,
            name=name,
            namespace=given['namespace'],
            parameters=[str(folder / 'parameters.yaml')],
            output='screen',
        )
        for name in (*spec.nodes, *([VISUALIZER] if show else []))
    }
    windows = [rviz(given['namespace'])] if show else []
    end = RegisterEventHandler(OnProcessExit(on_exit=End(nodes)))
    cleanup = RegisterEventHandler(OnShutdown(on_shutdown=lambda *_: scratch.cleanup()))
    return [*nodes.values(), *windows, end, cleanup]


def rviz(namespace):
    """Return RViz with the shipped configuration, on the topics of the namespace."""
    return Node(
        package='rviz2',
        executable='rviz2',
        namespace=namespace,
        arguments=['-d', str(share_directory() / 'config/rviz/ballbot.rviz')],
        # Use sim time, so that RViz discards its transforms when time jumps back.
        parameters=[{'use_sim_time': True}],
        remappings=[
            (f'/{topic.name}', topic.name)
            for topic in (MAP, MARKERS, PLANT_ODOM, ROBOT_DESCRIPTION)
        ],
        output='screen',
    )


def generate_launch_description():
    """Return the arguments and the graph."""
    arguments = [
        DeclareLaunchArgument(
            name,
            default_value=default,
            description=description,
            choices=['true', 'false'] if name in SWITCHES else None,
        )
        for name, (default, description) in ARGUMENTS.items()
    ]
    return LaunchDescription([*arguments, OpaqueFunction(function=launch_graph)])
