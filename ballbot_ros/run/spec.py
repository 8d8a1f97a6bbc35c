"""The specification of a run: what to simulate, how, and where to record it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from ballbot_ros.analysis.parent import Parent
from ballbot_ros.controllers.codegen.implementation import compose_controller
from ballbot_ros.controllers.loading import LoadedController
from ballbot_ros.engine.devices import ALL_DEVICES
from ballbot_ros.engine.scenario.reader import IDEAL, load_profile, load_scenario
from ballbot_ros.engine.scenario.scenario import Scenario
from ballbot_ros.engine.trajectory import Trajectory
from ballbot_ros.errors import BallbotError
from ballbot_ros.parameters import (
    CONTROLLER,
    GAMEPAD,
    GYRO,
    NODES,
    PLANT,
    RECORDER,
    ROLES,
    SUPERVISOR,
    GamepadParameters,
    ParameterError,
    ParameterSet,
    PlantParameters,
    RecorderParameters,
    SupervisorParameters,
)
from ballbot_ros.parameters.files import assign, assign_values, read_parameter_file
from ballbot_ros.parameters.timing import TICK_S
from ballbot_ros.parameters.yaml_document import is_yaml_path
from ballbot_ros.robot.brick.faults import all_faults
from ballbot_ros.robot.world.floor_map import is_file_name
from ballbot_ros.robot.world.world import World
from ballbot_ros.run.requirements import Processes


@dataclass(frozen=True, kw_only=True)
class RunOptions:
    """Settings of a run that apply to any scenario.

    In order of increasing precedence: profile, scenario, `values`, `parameter_file`,
    `real_time_factor` and `seed`, `assignments`, `controller`.

    Attributes
    ----------
    profile : str or None
        Device profile; None for the scenario's.
    parameter_file : Path or None
        Parameter file that overrides the scenario.
    real_time_factor : float or None
        Pace against the wall clock; None for the one in scenario or parameter file.
    default_real_time_factor : float or None
        Pace if `real_time_factor`, scenario and parameter file set none; None for the parameter's
        default.
    seed : int or None
        Seed of the device noise and jitter; None for the one in scenario or parameter file.
    values : mapping of str to object
        Values of parameters, by ``node.param``.
    assignments : sequence of str
        The same as texts, ``node.param=value``.
    controller : str, LoadedController or None
        Reference to a controller, or one that has none, for a run in this process; None for that of
        the scenario.
    external : sequence of str
        Roles that programs of the user take.
    output : Path or None
        Folder for recording and figure; None for a new one under ``runs/``.
    """

    processes: Processes = Processes.SEPARATE
    profile: str | None = None
    parameter_file: Path | None = None
    real_time_factor: float | None = None
    default_real_time_factor: float | None = 0.0
    seed: int | None = None
    values: Mapping[str, object] = field(default_factory=dict)
    assignments: Sequence[str] = ()
    controller: str | LoadedController | None = None
    external: Sequence[str] = ()
    output: Path | None = None
    record: bool = True


@dataclass(frozen=True)
class RunSpec:
    """A run that has been checked and can be executed; create it with :meth:`of_scenario`.

    Attributes
    ----------
    parameters : ParameterSet
        Parameters of all nodes; a map file and the file of a controller have absolute paths.
    output : Path or None
        Folder for recording and figure. None means a new one under ``runs/`` if the run is
        recorded, and no folder otherwise.
    controller : LoadedController or None
        The class of a controller other than the document's.
    parent : Parent or None
        The recorded run that it is a branch of.
    earlier : Trajectory or None
        The motion of that run, for the figure.
    """

    scenario: Scenario
    parameters: ParameterSet = field(default_factory=ParameterSet)
    processes: Processes = Processes.SEPARATE
    output: Path | None = None
    record: bool = True
    controller: LoadedController | None = None
    external: tuple[str, ...] = ()
    parent: Parent | None = None
    earlier: Trajectory | None = None

    @property
    def nodes(self) -> tuple[str, ...]:
        """The nodes that the run starts, none for the `external` roles."""
        left_out = (*self.external, *(() if self.record else (RECORDER,)))
        return tuple(name for name in NODES if name not in left_out)

    @property
    def name(self) -> str:
        """Name of the scenario, which recording and figure share."""
        return self.scenario.name

    @property
    def plant(self) -> PlantParameters:
        """Parameters of the plant."""
        return self.parameters.of(PlantParameters)

    @classmethod
    def of_scenario(cls, reference: str, options: RunOptions | None = None) -> RunSpec:
        """Return the run of a scenario, ready to execute.

        Parameters
        ----------
        reference : str
            Name of a shipped scenario, or a file.

        Raises
        ------
        BallbotError
            As for :meth:`compose`; also if the run has no end, or a parameter sets an output file.
        """
        options = options or RunOptions()
        spec = cls.compose(reference, options)
        if spec.plant.duration < TICK_S:
            raise ParameterError(
                f'{_origin(options, PLANT, "duration")}{PLANT}.duration is '
                f'{spec.plant.duration:g}: a scenario must last at least {TICK_S:g} s'
            )
        check_reserved_parameters(spec.parameters, lambda node, name: _origin(options, node, name))
        return spec

    @classmethod
    def compose(cls, reference: str | None, options: RunOptions) -> RunSpec:
        """Return a run that may have no end, and whose parameters may set its output files.

        `reference` names a shipped scenario, or a file; None stands for a robot that balances until
        it is stopped. It raises BallbotError if a scenario, profile, parameter file, option,
        assignment, map or start position is not valid, or the controller can't run here; the
        message is one line.
        """
        if reference is None:
            profile = IDEAL if options.profile is None else options.profile
            scenario = Scenario(parameters=load_profile(profile))
        else:
            scenario = load_scenario(reference, options.profile)
        parameters = ParameterSet(scenario.parameters)
        _apply(options, parameters)
        if reference is not None:
            _follow_scenario(reference, options, parameters)
        if options.processes is Processes.NONE and not parameters.of(PlantParameters).lockstep:
            raise ParameterError(
                f'{_origin(options, PLANT, "lockstep")}{PLANT}.lockstep: false requires nodes; use '
                '--processes separate or one'
            )
        external = _external_roles(options)
        given = options.controller if isinstance(options.controller, LoadedController) else None
        controller = None if CONTROLLER in external else compose_controller(parameters, given)
        all_faults(parameters.of)
        resolve_map(parameters)
        return cls(
            scenario,
            parameters,
            options.processes,
            options.output,
            options.record,
            controller,
            external,
        )


def _external_roles(options: RunOptions) -> tuple[str, ...]:
    """Return the roles that programs of the user take, in the order of the table."""
    for role in options.external:
        if role not in ROLES:
            raise BallbotError(f'--external {role}: no such role; the roles are {", ".join(ROLES)}')
        if options.processes is Processes.NONE:
            raise BallbotError(
                f'--external {role}: requires nodes; use --processes separate or one'
            )
    if CONTROLLER in options.external and options.controller is not None:
        raise BallbotError(
            f'--controller {options.controller}: contradicts --external {CONTROLLER}'
        )
    if RECORDER in options.external and not options.record:
        raise BallbotError(f'--no-record: contradicts --external {RECORDER}')
    for assignment in options.assignments:
        node = assignment.partition('.')[0]
        if node in options.external:
            raise BallbotError(
                f'--set {assignment}: {node} is external; set its parameters where you start it'
            )
    return tuple(role for role in ROLES if role in options.external)


def _apply(options: RunOptions, parameters: ParameterSet) -> None:
    """Apply the options."""
    assign_values(parameters, options.values)
    if options.parameter_file is not None:
        parameters.update(read_parameter_file(options.parameter_file))
    factor = options.real_time_factor
    if factor is None and not parameters.is_set(PLANT, 'real_time_factor'):
        factor = options.default_real_time_factor
    if factor is not None:
        parameters.set(PLANT, 'real_time_factor', factor, '--real-time-factor')
    if options.seed is not None:
        parameters.set(GYRO, 'seed', options.seed)
    for assignment in options.assignments:
        assign(parameters, assignment)
    controller = options.controller
    if isinstance(controller, LoadedController):
        controller = controller.code.reference
    if controller is not None:
        parameters.set(CONTROLLER, 'implementation', controller, '--controller')


def _origin(options: RunOptions, node: str, name: str) -> str:
    """Return the origin of a parameter's value, as the start of an error message."""
    for assignment in reversed(options.assignments):
        if assignment.partition('=')[0] == f'{node}.{name}':
            return f'--set {assignment}: '
    return f'{options.parameter_file}: ' if options.parameter_file is not None else ''


def _follow_scenario(reference: str, options: RunOptions, parameters: ParameterSet) -> None:
    """Make the nodes load the scenario, undisturbed by other inputs."""
    for node, named in (
        (GAMEPAD, parameters.of(GamepadParameters).scenario),
        (SUPERVISOR, parameters.of(SupervisorParameters).scenario),
    ):
        if named:
            raise ParameterError(
                f'{_origin(options, node, "scenario")}{node}.scenario cannot be set: the scenario '
                f'is {reference}'
            )
    if is_yaml_path(reference):
        reference = str(Path(reference).resolve())
    parameters.set(GAMEPAD, 'scenario', reference)
    if not parameters.is_set(GAMEPAD, 'device'):
        # Read no gamepad unless asked to: one that is plugged in must not disturb a scenario.
        parameters.set(GAMEPAD, 'device', '')


def check_reserved_parameters(
    parameters: ParameterSet, origin: Callable[[str, str], str] = lambda node, name: ''
) -> None:
    """Raise ParameterError if a parameter is set for files that the run itself chooses.

    `origin` returns the origin of a parameter's value, as the start of an error message.
    """
    recorder = parameters.of(RecorderParameters)
    for node, name, value in (
        (RECORDER, 'output', recorder.output),
        (RECORDER, 'attachments', recorder.attachments),
        (PLANT, 'trajectory_file', parameters.of(PlantParameters).trajectory_file),
    ):
        if value:
            raise ParameterError(
                f'{origin(node, name)}{node}.{name} cannot be set: a run writes its files '
                'to the folder of --output'
            )


def resolve_map(parameters: ParameterSet) -> None:
    """Make the path of a map file absolute; check that plant and devices can use the map.

    It raises WorldError if the map does not exist, the start position is blocked, or the sonar's
    parameters don't fit the map.
    """
    World.of(parameters.of(PlantParameters))
    for device in ALL_DEVICES:
        device.make(parameters.of(device.parameters))
    name = parameters.of(PlantParameters).map
    if is_file_name(name):
        parameters.set(PLANT, 'map', str(Path.cwd() / name))
