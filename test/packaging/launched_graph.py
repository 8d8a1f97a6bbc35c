"""What `launch_test` does in test_launch_file.py: the launch file starts the graph and ends it."""

import os
import unittest
from pathlib import Path

import launch_testing
from graph import LAST_RESORT_S
from launch import LaunchDescription
from launch.actions import IncludeLaunchDescription
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch_ros.substitutions import FindPackageShare
from launch_testing.actions import ReadyToTest
from launch_testing.asserts import assertExitCodes

from ballbot_ros.parameters import NODES


@launch_testing.ready_to_test_action_timeout(LAST_RESORT_S)
def generate_test_description():
    folder = Path(os.environ['BALLBOT_TEST_FOLDER'])
    (folder / 'parameters.yaml').write_text('/**/plant_sim: {ros__parameters: {seed: 5}}')
    arguments = {
        'controller': 'pid',
        'params_file': str(folder / 'parameters.yaml'),
        'real_time_factor': '1',
        'record': 'true',
        'output': str(folder / 'x.mcap'),
    }
    share = FindPackageShare('ballbot_ros').find('ballbot_ros')
    source = PythonLaunchDescriptionSource(f'{share}/launch/ballbot.launch.py')
    graph = IncludeLaunchDescription(source, launch_arguments=arguments.items())
    return LaunchDescription([graph, ReadyToTest()])


class TestRunningGraph(unittest.TestCase):
    def test_a_run_begins(self, proc_output):
        proc_output.assertWaitFor('run 1 begins', timeout=LAST_RESORT_S)


@launch_testing.post_shutdown_test()
class TestEndedGraph(unittest.TestCase):
    def test_every_node_has_ended_by_itself(self, proc_info):
        assert {name.rpartition('-')[0] for name in proc_info.process_names()} == {*NODES}
        assertExitCodes(proc_info)
