"""The decisions of the launch file and, where ROS's own launch is installed, the launched graph."""

import os
import signal
import subprocess
import sys
from contextlib import suppress
from importlib.util import find_spec, module_from_spec, spec_from_file_location
from pathlib import Path
from types import ModuleType, SimpleNamespace

import pytest
from graph import LAST_RESORT_S, environment

from ballbot_ros.lockstep.run_actions import Outcome
from ballbot_ros.recording.reader import RecordingReader
from ballbot_ros.recording.writer import RUN_OUTCOME

ROOT = Path(__file__).resolve().parents[2]
FILE = ROOT / 'launch/ballbot.launch.py'
LAUNCH_TEST = Path(__file__).with_name('launched_graph.py')
NAMES = {
    'launch': ['LaunchDescription'],
    'launch.actions': [
        'DeclareLaunchArgument', 'OpaqueFunction', 'RegisterEventHandler', 'Shutdown',
    ],
    'launch.event_handlers': ['OnProcessExit', 'OnShutdown'],
    'launch.substitutions': ['LaunchConfiguration'],
    'launch_ros': [],
    'launch_ros.actions': ['Node'],
    'launch_ros.substitutions': ['FindPackagePrefix'],
}  # fmt: skip


@pytest.fixture
def launch_file(monkeypatch):
    pytest.importorskip('yaml')
    for name, contents in NAMES.items():
        module = ModuleType(name)
        for each in contents:
            setattr(module, each, lambda each=each, **given: (each, given))
        monkeypatch.setitem(sys.modules, name, module)
    spec = spec_from_file_location('ballbot_launch', FILE)
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    monkeypatch.setattr(sys, 'argv', ['ros2', 'launch', 'ballbot_ros', 'ballbot.launch.py'])
    return module


@pytest.mark.parametrize(
    ('given', 'words'),
    [
        ('scenaro:=stationary', "no launch argument 'scenaro'; did you mean scenario?"),
        ('real_time_factr:=0', 'did you mean real_time_factor?'),
        ('qqq:=1', 'known: scenario, params_file, controller, external, real_time_factor,'),
    ],
)
def test_a_misspelt_argument_is_an_error(launch_file, given, words):
    with pytest.raises(launch_file.LaunchError) as error:
        launch_file.check_names(SimpleNamespace(argv=['record:=true', given]))
    assert words in str(error.value)


def test_its_own_arguments_and_those_of_ros2_launch_are_accepted(launch_file):
    names = [*launch_file.ARGUMENTS, 'launch-prefix']
    launch_file.check_names(SimpleNamespace(argv=[f'{name}:=x' for name in names]))


def test_a_file_that_includes_it_may_have_other_arguments(launch_file, monkeypatch):
    monkeypatch.setattr(sys, 'argv', ['ros2', 'launch', 'my_package', 'my.launch.py'])
    launch_file.check_names(SimpleNamespace(argv=['scenaro:=stationary']))


GOES_ON, ENDS = None, 'ends'
EVENTS = {
    'the run is completed': ([('plant_sim', 0)], [ENDS]),
    'the run fails': ([('plant_sim', 1)], ['plant_sim ended with status 1']),
    'the plant refuses to start': ([('plant_sim', 2)], ['plant_sim ended with status 2']),
    'the plant is killed': ([('plant_sim', -9)], ['plant_sim ended with status -9']),
    'a node refuses to start': ([('gyro_driver', 2)], ['gyro_driver ended with status 2']),
    'a driver is killed, and the run completed by another': (
        [('gyro_driver', -9), ('plant_sim', 0)], [GOES_ON, ENDS],
    ),
    'the recorder fails': (
        [('recorder', 1), ('plant_sim', 0)], [GOES_ON, 'recorder ended with status 1'],
    ),
    'the recorder cannot finish its file': (
        [('plant_sim', 0), 'shutdown', ('recorder', 1)], [ENDS, 'recorder ended with status 1'],
    ),
    'all are told to end': (
        ['shutdown', ('gyro_driver', 0), ('plant_sim', 0), ('recorder', -2)],
        [GOES_ON, ENDS, GOES_ON],
    ),
    'a window is closed': ([('rviz2', 1), ('plant_sim', 0)], [GOES_ON, ENDS]),
}  # fmt: skip


@pytest.mark.parametrize('name', EVENTS)
def test_the_launch_ends_as_the_run_does(launch_file, name):
    events, expected = EVENTS[name]
    nodes = {role: object() for role in ('plant_sim', 'gyro_driver', 'recorder')}
    end, context, decisions = launch_file.End(nodes), SimpleNamespace(is_shutdown=False), []
    for event in events:
        if event == 'shutdown':
            context.is_shutdown = True
            continue
        role, status = event
        try:
            done = end(SimpleNamespace(action=nodes.get(role), returncode=status), context)
        except launch_file.LaunchError as error:
            decisions.append(str(error))
        else:
            decisions.append(ENDS if done else GOES_ON)
    assert decisions == expected


@pytest.fixture
def launch_environment(domain, tmp_path):
    """Return the variables with which `launch_testing` is found, also that of scripts/ros2."""
    copy = Path(sys.prefix) / 'ros2'
    modules = [str(folder) for folder in copy.glob('lib/python*/site-packages')]
    if find_spec('launch_testing'):
        modules = []
    elif not modules:
        pytest.skip('launch_testing not found: source a ROS 2 Jazzy, or run scripts/ros2 once')
    paths = {
        'PYTHONPATH': [str(ROOT), str(ROOT / 'test'), *modules],
        'AMENT_PREFIX_PATH': [sys.prefix, str(copy)],
    }
    return {
        **environment(domain),
        **{name: os.pathsep.join([*new, os.environ.get(name, '')]) for name, new in paths.items()},
        'ROS_LOG_DIR': str(tmp_path),
        'BALLBOT_TEST_FOLDER': str(tmp_path),
    }


@pytest.mark.graph
@pytest.mark.launched
def test_the_launched_graph_runs_and_records(launch_environment, tmp_path):
    process = subprocess.Popen(
        [sys.executable, '-m', 'launch_testing.launch_test', LAUNCH_TEST],
        env=launch_environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
        start_new_session=True,
    )  # fmt: skip
    try:
        output, _ = process.communicate(timeout=LAST_RESORT_S)
    finally:
        with suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
    assert process.returncode == 0, output
    with RecordingReader(tmp_path / 'x.mcap') as recording:
        assert recording.complete
        assert recording.metadata()[RUN_OUTCOME]['outcome'] == Outcome.STOPPED
