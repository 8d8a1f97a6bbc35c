"""Launches the whole graph and, if wanted, the recorder and RViz."""

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

from ballbot_ros.files import temporary_folder
from ballbot_ros.messages.topics import MAP, MARKERS, PLANT_ODOM, ROBOT_DESCRIPTION
from ballbot_ros.parameters import (
    ALL_NODES,
    NODES,
    PLANT,
    RECORDER,
    VISUALIZER,
    ParameterSet,
)
from ballbot_ros.parameters.files import write_parameter_file
from ballbot_ros.run.graph import graph_parameters
from ballbot_ros.run.spec import RunOptions, RunSpec
from ballbot_ros.share import share_directory

ARGUMENTS = {
    'scenario': ('', 'name or file of a scenario; empty: balance until stopped'),
    'params_file': ('', 'parameter file whose values come on top'),
    'real_time_factor': ('', '1: real time, 0: as fast as it can; empty: as the files say, or 1'),
    'record': ('false', 'true: record the run'),
    'output': ('', 'recording to write; empty: a new one under runs/'),
    'namespace': ('', 'namespace of the nodes'),
    'rviz': ('false', 'true: show the robot in RViz'),
}
SWITCHES = ('record', 'rviz')
OF_ROS = ('launch-prefix', 'launch-prefix-filter')
"""What the command `ros2 launch` adds of its own."""


class LaunchError(RuntimeError):
    """What ends the launch with a status other than 0."""


def check_names(context):
    """Refuse an argument that is misspelt, where this file is the one that was launched.

    What another launch file includes may have arguments of that file about it.
    """
    if Path(__file__).name not in {Path(word).name for word in sys.argv}:
        return
    for word in context.argv:
        name = word.partition(':=')[0]
        if name not in ARGUMENTS and name not in OF_ROS:
            close = get_close_matches(name, ARGUMENTS)
            hint = f'did you mean {close[0]}?' if close else f'there are {", ".join(ARGUMENTS)}'
            raise LaunchError(f'no launch argument {name!r}; {hint}')


class End:
    """Ends the launch with the run, and as the run has ended.

    The plant ends when the run does. A node that refuses to start ends with status 2; one that
    fails, with 1, and the plant, which misses it, says more. One that was killed may be started
    again.
    """

    def __init__(self, nodes):
        self._names = {node: name for name, node in nodes.items()}
        self._failure = ''

    def __call__(self, event, context):
        """Return what follows the end of a process, or raise LaunchError."""
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
        # If it is missing that ends the launch here, before there are processes to be left behind.
        FindPackagePrefix('rviz2').perform(context)
    factor = None
    if given['real_time_factor']:
        factor = yaml.safe_load(given['real_time_factor'])
        ParameterSet().set(PLANT, 'real_time_factor', factor, 'real_time_factor:=')
    options = RunOptions(
        parameter_file=Path(given['params_file']) if given['params_file'] else None,
        real_time_factor=factor,
        default_real_time_factor=None,
        record=record,
    )
    spec = RunSpec.compose(given['scenario'] or None, options)
    scratch = temporary_folder()
    folder = Path(scratch.name)
    recording = Path(given['output']) if given['output'] else None
    parameters = graph_parameters(spec, recording, folder)
    write_parameter_file(folder / 'parameters.yaml', parameters, ALL_NODES)
    names = [name for name in NODES if name != RECORDER or record]
    nodes = {
        name: Node(
            package='ballbot_ros',
            executable=name,
            name=name,
            namespace=given['namespace'],
            parameters=[str(folder / 'parameters.yaml')],
            output='screen',
        )
        for name in (*names, *([VISUALIZER] if show else []))
    }
    windows = [rviz(given['namespace'])] if show else []
    end = RegisterEventHandler(OnProcessExit(on_exit=End(nodes)))
    tidy = RegisterEventHandler(OnShutdown(on_shutdown=lambda *_: scratch.cleanup()))
    return [*nodes.values(), *windows, end, tidy]


def rviz(namespace):
    """Return RViz with the shipped configuration, on the topics of the namespace."""
    return Node(
        package='rviz2',
        executable='rviz2',
        namespace=namespace,
        arguments=['-d', str(share_directory() / 'config/rviz/ballbot.rviz')],
        # On sim time its transforms are forgotten when time leaps back.
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
