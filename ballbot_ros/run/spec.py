"""The specification of a run: what is simulated, how, and where it is recorded."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from ballbot_ros.codegen.implementation import require_implementation
from ballbot_ros.parameters import (
    CONTROLLER,
    GAMEPAD,
    GYRO,
    PLANT,
    SUPERVISOR,
    ControllerParameters,
    GamepadParameters,
    ParameterError,
    ParameterSet,
    PlantParameters,
    SupervisorParameters,
)
from ballbot_ros.parameters.assignment import assign
from ballbot_ros.parameters.files import read_parameter_file
from ballbot_ros.scenario.library import load_profile, load_scenario
from ballbot_ros.scenario.reader import IDEAL
from ballbot_ros.scenario.scenario import Scenario
from ballbot_ros.simulation.devices import DEVICES
from ballbot_ros.text_enum import TextEnum
from ballbot_ros.world.library import is_file_name
from ballbot_ros.world.world import World


class Processes(TextEnum):
    """How the nodes of a run are distributed over processes."""

    SEPARATE = 'separate'
    ONE = 'one'
    NONE = 'none'
    """No nodes at all: the closed loop without ROS."""


@dataclass(frozen=True, kw_only=True)
class RunOptions:
    """What a user chooses for a run, whatever its scenario.

    Later ones override earlier ones: profile, scenario, parameter file, the attributes below it,
    assignments, controller.

    Attributes
    ----------
    processes : Processes
    profile : str or None
        Profile of the devices; None for that of the scenario.
    parameter_file : Path or None
        File whose values override those of the scenario.
    real_time_factor : float or None
        Pace against the wall clock; None for that of scenario and file.
    default_real_time_factor : float or None
        Pace where neither sets one; None for the default of the parameter.
    seed : int or None
        Seed of the device noise; None for that of scenario and file.
    assignments : sequence of str
        Values of parameters, as ``node.param=value``.
    controller : str or None
        Implementation of the controller; None for that of the parameters.
    output : Path or None
        Folder for recording and picture; None for a new one under ``runs/``.
    record : bool
    """

    processes: Processes = Processes.SEPARATE
    profile: str | None = None
    parameter_file: Path | None = None
    real_time_factor: float | None = None
    default_real_time_factor: float | None = 0.0
    seed: int | None = None
    assignments: Sequence[str] = ()
    controller: str | None = None
    output: Path | None = None
    record: bool = True


@dataclass(frozen=True)
class RunSpec:
    """A run that can be carried out: everything in it has been checked.

    Attributes
    ----------
    scenario : Scenario
    parameters : ParameterSet
        Of all nodes; a map that is a file is an absolute path.
    processes : Processes
    output : Path or None
        Folder for recording and picture. With None there is a new one under ``runs/`` if the run
        is recorded, and none otherwise.
    record : bool
    """

    scenario: Scenario
    parameters: ParameterSet = field(default_factory=ParameterSet)
    processes: Processes = Processes.SEPARATE
    output: Path | None = None
    record: bool = True

    @property
    def name(self) -> str:
        """Name of the scenario, which recording and picture have too."""
        return self.scenario.name

    @property
    def plant(self) -> PlantParameters:
        """Parameters of the plant."""
        return self.parameters.of(PlantParameters)

    @classmethod
    def of_scenario(cls, reference: str, options: RunOptions | None = None) -> RunSpec:
        """Return the run of a scenario, a shipped one by its name or a file.

        Without a scenario (``''``) the robot balances until it is told to stop.

        Raises
        ------
        BallbotError
            One line on what is not allowed: in scenario, profile or parameter file, an option, an
            assignment, the map, the start position, or a controller that can't run here.
        """
        options = options or RunOptions()
        if reference:
            scenario = load_scenario(reference, options.profile)
        else:
            profile = IDEAL if options.profile is None else options.profile
            scenario = Scenario(parameters=load_profile(profile))
        parameters = ParameterSet()
        parameters.update(scenario.parameters)
        _apply(options, parameters)
        if reference:
            _follow_scenario(reference, parameters)
        require_implementation(parameters.of(ControllerParameters).implementation)
        resolve_map(parameters)
        return cls(scenario, parameters, options.processes, options.output, options.record)


def _apply(options: RunOptions, parameters: ParameterSet) -> None:
    """Set what the options say."""
    if options.parameter_file is not None:
        parameters.update(read_parameter_file(options.parameter_file))
    factor = options.real_time_factor
    if factor is None and not parameters.is_set(PLANT, 'real_time_factor'):
        factor = options.default_real_time_factor
    if factor is not None:
        parameters.set(PLANT, 'real_time_factor', factor)
    if options.seed is not None:
        parameters.set(GYRO, 'seed', options.seed)
    for assignment in options.assignments:
        assign(parameters, assignment)
    if options.controller:
        parameters.set(CONTROLLER, 'implementation', options.controller)


def _follow_scenario(reference: str, parameters: ParameterSet) -> None:
    """Let the nodes load the scenario, and nothing else disturb it."""
    for node, named in (
        (GAMEPAD, parameters.of(GamepadParameters).scenario),
        (SUPERVISOR, parameters.of(SupervisorParameters).scenario),
    ):
        if named:
            raise ParameterError(f'{node}.scenario can not be set: the scenario is {reference}')
    if '/' in reference or reference.endswith(('.yaml', '.yml')):
        reference = str(Path(reference).resolve())
    parameters.set(GAMEPAD, 'scenario', reference)
    if not parameters.is_set(GAMEPAD, 'device'):
        # Whatever is plugged in must not disturb a scenario.
        parameters.set(GAMEPAD, 'device', '')


def resolve_map(parameters: ParameterSet) -> None:
    """Make the path of a map file absolute; check that plant and devices can use the map.

    Raises
    ------
    WorldError
        If there is no such map, the robot can't start where it is to, or the sonar can't look at
        the map.
    """
    World.of(parameters.of(PlantParameters))
    for device in DEVICES:
        device.make(parameters.of(device.parameters))
    name = parameters.of(PlantParameters).map
    if is_file_name(name):
        parameters.set(PLANT, 'map', str(Path.cwd() / name))
