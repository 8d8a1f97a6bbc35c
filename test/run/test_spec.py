"""A run's specification: precedence of its settings, and mistakes refused before the start."""

import numpy as np
import pytest
import yaml
from laws import refusal

from ballbot_ros import __version__
from ballbot_ros.engine.scenario.reader import load_profile, load_scenario
from ballbot_ros.errors import BallbotError
from ballbot_ros.parameters import (
    NODES,
    ControllerParameters,
    GamepadParameters,
    GyroParameters,
    ParameterSet,
    PlantParameters,
)
from ballbot_ros.parameters.files import read_parameter_file, write_parameter_file
from ballbot_ros.recording.rosbag2 import PARAMETERS, SCENARIO, VERSIONS
from ballbot_ros.robot.world.floor_map import read_map_file
from ballbot_ros.run.execution import execute
from ballbot_ros.run.graph import attachments_of
from ballbot_ros.run.requirements import Processes
from ballbot_ros.run.spec import RunOptions, RunSpec

NOISE = """purpose: noise of its own
duration: 1
profile: hardware
parameters:
  gyro_driver: {noise: 0.25}
"""


@pytest.fixture
def scenario(tmp_path):
    path = tmp_path / 'noisy.yaml'
    path.write_text(NOISE)
    return str(path)


def parameter_file(tmp_path, text):
    path = tmp_path / 'mine.yaml'
    path.write_text(text)
    return path


def of_gyro(spec):
    return spec.parameters.of(GyroParameters)


def test_each_level_overrides_the_one_before(tmp_path, scenario):
    """Profile, scenario, parameter file, options, assignments."""
    hardware = load_profile('hardware').of(GyroParameters)
    own = RunSpec.of_scenario(scenario)
    assert of_gyro(own).drift == hardware.drift
    assert of_gyro(own).noise == 0.25
    ideal = RunSpec.of_scenario(scenario, RunOptions(profile='ideal'))
    assert of_gyro(ideal).drift == 0.0
    assert of_gyro(ideal).noise == 0.25

    file = parameter_file(tmp_path, 'gyro_driver: {ros__parameters: {noise: 0.5, seed: 3}}')
    filed = of_gyro(RunSpec.of_scenario(scenario, RunOptions(parameter_file=file)))
    assert (filed.noise, filed.seed, filed.drift) == (0.5, 3, hardware.drift)
    seeded = of_gyro(RunSpec.of_scenario(scenario, RunOptions(parameter_file=file, seed=4)))
    assert seeded.seed == 4
    words = ('gyro_driver.seed=5', 'gyro_driver.noise=1')
    options = RunOptions(parameter_file=file, seed=4, assignments=words)
    assigned = of_gyro(RunSpec.of_scenario(scenario, options))
    assert (assigned.noise, assigned.seed) == (1.0, 5)


def test_the_pace_comes_from_the_highest_level_that_sets_it(tmp_path):
    def factor(**options):
        return RunSpec.of_scenario('stationary', RunOptions(**options)).plant.real_time_factor

    file = parameter_file(tmp_path, 'plant_sim: {ros__parameters: {real_time_factor: 2.0}}')
    assert factor() == 0.0
    assert factor(default_real_time_factor=1.0) == 1.0
    assert factor(default_real_time_factor=None) == PlantParameters().real_time_factor
    assert factor(parameter_file=file, default_real_time_factor=1.0) == 2.0
    assert factor(parameter_file=file, real_time_factor=3.0) == 3.0


def test_another_profile_is_that_of_the_attached_scenario(tmp_path):
    """Thus a run of the attached scenario has the same devices."""
    spec = RunSpec.of_scenario('square', RunOptions(profile='hardware'))
    shipped = load_scenario('square')
    assert (shipped.profile, spec.scenario.profile) == ('ideal', 'hardware')
    attached = tmp_path / 'square.yaml'
    attached.write_bytes(attachments_of(spec)[SCENARIO])
    again = RunSpec.of_scenario(str(attached))
    for name in ('profile', 'purpose', 'vertical', 'horizontal', 'pushes', 'expectations'):
        assert getattr(again.scenario, name) == getattr(spec.scenario, name)
    assert attachments_of(again)[PARAMETERS] == attachments_of(spec)[PARAMETERS]
    unchanged = RunSpec.of_scenario('square')
    assert attachments_of(unchanged)[SCENARIO].decode() == shipped.text


def test_a_run_can_be_repeated_from_its_attached_parameters(tmp_path):
    """The attachment has every parameter of every node, also those that a scenario can't set."""
    words = ('controller.pwm_gain=0.9', 'plant_sim.duration=1')
    options = RunOptions(processes=Processes.NONE, record=False, seed=7, assignments=words)
    spec = RunSpec.of_scenario('hardware_standing', options)
    file = tmp_path / 'parameters.yaml'
    file.write_bytes(attachments_of(spec)[PARAMETERS])
    options = RunOptions(processes=Processes.NONE, record=False, parameter_file=file)
    again = RunSpec.of_scenario('hardware_standing', options)
    assert execute(again).duty_sha256 == execute(spec).duty_sha256
    assert again.parameters.of(ControllerParameters).pwm_gain == 0.9


def test_the_map_of_a_run_is_attached_without_its_path(tmp_path):
    """The parameters name the attached copy of a file, but a shipped map by its own name."""
    image = read_map_file('track')
    path = tmp_path / 'floor.png'
    path.write_bytes(image)
    for name, named in ((str(path), 'map.png'), ('track', 'track'), ('', '')):
        options = RunOptions(assignments=[f'plant_sim.map={name}'])
        attached = attachments_of(RunSpec.of_scenario('stationary', options))
        assert attached.get('map.png') == (image if name else None), name
        file = parameter_file(tmp_path, attached[PARAMETERS].decode())
        assert read_parameter_file(file).of(PlantParameters).map == named


def test_the_attached_versions_begin_with_this_package():
    versions = yaml.safe_load(attachments_of(RunSpec.of_scenario('stationary'))[VERSIONS])
    assert list(versions)[:2] == ['ballbot_ros', 'python']
    assert (versions['ballbot_ros'], versions['numpy']) == (__version__, np.__version__)


def test_without_a_scenario_the_robot_balances_endlessly():
    spec = RunSpec.compose(None, RunOptions(profile='hardware'))
    assert spec.plant.duration == 0.0
    assert spec.parameters.of(GamepadParameters) == GamepadParameters()
    assert of_gyro(spec) == load_profile('hardware').of(GyroParameters)


def test_a_gamepad_that_is_plugged_in_does_not_disturb_a_scenario():
    def device(*assignments):
        spec = RunSpec.of_scenario('stationary', RunOptions(assignments=assignments))
        return spec.parameters.of(GamepadParameters).device

    assert GamepadParameters().device == 'any'
    assert device() == ''
    assert device('gamepad_teleop.device=pad') == 'pad'


def test_a_mistake_is_refused_in_one_line():
    for name, value, told in (
        ('profile', 'soft', "unknown profile 'soft'; known: ideal, hardware"),
        ('parameter_file', '/no/such.yaml', '/no/such.yaml: No such file'),
        ('seed', -1, 'gyro_driver.seed: -1 is not within'),
        ('real_time_factor', 'x', "--real-time-factor: plant_sim.real_time_factor: 'x'"),
        ('controller', 'fortran', "no controller 'fortran': give one of python, c, arm"),
    ):
        options = RunOptions(**{name: value})
        assert told in refusal(BallbotError, RunSpec.of_scenario, 'stationary', options), name
    for assignment, told in (
        ('gamepad_teleop.scenario=push', 'the scenario is stationary'),
        ('supervisor.scenario=push', 'the scenario is stationary'),
        ('recorder.output=x.mcap', 'recorder.output cannot be set: a run writes its files to'),
        ('recorder.attachments=x', 'recorder.attachments cannot be set'),
        ('plant_sim.trajectory_file=x', 'plant_sim.trajectory_file cannot be set'),
        ('plant_sim.duration=0', 'plant_sim.duration is 0: a scenario must last at least'),
        ('plant_sim.map=mars', "unknown map 'mars'"),
    ):
        options = RunOptions(assignments=[assignment, 'gyro_driver.seed=1'])
        text = refusal(BallbotError, RunSpec.of_scenario, 'stationary', options)
        assert told in text, assignment
        assert text.startswith(f'--set {assignment}: ') or 'unknown' in text, assignment


def test_a_run_starts_no_node_for_an_external_role():
    assert RunSpec.of_scenario('stationary').nodes == NODES
    options = RunOptions(external=['recorder', 'gyro_driver', 'gyro_driver'])
    spec = RunSpec.of_scenario('stationary', options)
    assert spec.external == ('gyro_driver', 'recorder')
    assert set(NODES) - set(spec.nodes) == {'gyro_driver', 'recorder'}
    unrecorded = RunSpec.of_scenario('stationary', RunOptions(record=False))
    assert set(NODES) - set(unrecorded.nodes) == {'recorder'}


def test_an_external_controller_is_not_loaded(tmp_path):
    own = parameter_file(tmp_path, '/**/controller:\n  ros__parameters: {implementation: nosuch}')
    options = RunOptions(parameter_file=own, external=['controller'])
    assert RunSpec.of_scenario('stationary', options).controller is None
    with pytest.raises(BallbotError, match='nosuch'):
        RunSpec.of_scenario('stationary', RunOptions(parameter_file=own))


def test_an_external_role_that_can_not_be_is_refused():
    for told, values in (
        ('--external plant_sim: no such role; the roles are gyro_driver, ', {}),
        ('--external gyro_driver: requires nodes', {'processes': Processes.NONE}),
        ('--controller lqg: contradicts --external controller', {'controller': 'lqg'}),
        ('--no-record: contradicts --external recorder', {'record': False}),
        (
            '--set sonar_driver.seed=2: sonar_driver is external; set its parameters where',
            {'assignments': ['controller.user.x=1', 'sonar_driver.seed=2']},
        ),
    ):
        external = [told.rpartition('--external ')[2].partition(':')[0]]
        external = ['sonar_driver'] if 'assignments' in values else external
        options = RunOptions(external=external, **values)
        assert refusal(BallbotError, RunSpec.of_scenario, 'stationary', options).startswith(told)


def test_a_run_without_end_is_refused(tmp_path):
    """The file with the defaults has a duration of 0, for a graph without a scenario."""
    file = tmp_path / 'defaults.yaml'
    write_parameter_file(file, ParameterSet())
    options = RunOptions(parameter_file=file)
    with pytest.raises(
        BallbotError, match=rf'^{file}: plant_sim\.duration is 0: a scenario must last'
    ):
        RunSpec.of_scenario('stationary', options)
    options = RunOptions(parameter_file=file, assignments=['plant_sim.duration=2'])
    assert RunSpec.of_scenario('stationary', options).plant.duration == 2.0
    # A launched graph may run endlessly.
    assert RunSpec.compose('stationary', RunOptions(parameter_file=file)).plant.duration == 0.0


def test_a_scenario_with_an_unknown_profile_is_refused_for_any_profile_of_the_run(tmp_path):
    """The profile in the file must be valid, too, since each node reads the file itself."""
    path = tmp_path / 'typo.yaml'
    path.write_text('purpose: a typo\nduration: 1\nprofile: nope\n')
    with pytest.raises(BallbotError, match=rf"^{path}:3: unknown profile 'nope'"):
        RunSpec.of_scenario(str(path), RunOptions(profile='ideal'))
