"""Selection of the control program: the document's in Python or C, or another controller."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from ballbot_ros.controllers.controller import IDLE
from ballbot_ros.controllers.controller_program import (
    ControllerProgram,
    TickTimes,
    design,
    design_model,
    missing_design,
    own_rows,
    user_parameters,
)
from ballbot_ros.controllers.document.axis import task_timings
from ballbot_ros.controllers.document.program import TASK_NUMBERS, ControlProgram, task_load
from ballbot_ros.controllers.interface import SAME_TICK, PlaneEstimates, Program
from ballbot_ros.controllers.loading import (
    LoadedController,
    load_controller,
    public_reference,
    resolve_reference,
)
from ballbot_ros.errors import CodegenError, short_repr
from ballbot_ros.parameters import (
    CONTROLLER,
    DOCUMENTS_PROGRAM,
    NOT_DESIGNED,
    ControllerParameters,
    Parameter,
    ParameterError,
    ParameterSet,
    Value,
    is_own,
    parameters_of,
    suggest,
)
from ballbot_ros.parameters.changes import (
    IMPLEMENTATION,
    changes_text,
    parse_changes,
    parse_succession,
)
from ballbot_ros.robot.brick.brick import UINT32_MASK, DeviceInputs, DeviceOutputs
from ballbot_ros.robot.brick.faults import faults_of
from ballbot_ros.robot.brick.job_times import JobTimes, interrupt_load, load_of
from ballbot_ros.robot.brick.schedule import Schedule, TaskTiming


def missing_tool_for(name: str) -> str:
    """Return which tool to install first for an implementation; '' if none is missing."""
    if name not in DOCUMENTS_PROGRAM or name == 'python':
        return ''
    from ballbot_ros.controllers.codegen.toolchain import TARGETS, missing_tool

    return missing_tool(TARGETS[name])


def require_implementation(name: str) -> None:
    """Raise CodegenError, which names the Debian package, if an implementation lacks a tool."""
    if reason := missing_tool_for(name):
        raise CodegenError(reason)


@dataclass(frozen=True)
class Implementation:
    """An implementation of the controller, for given parameters.

    `make` creates a program with these tasks; `loaded` is the class of a controller other than the
    document's. `times` tells how long the ticks of its newest program take; they are not measured
    for the document's program.
    """

    parameters: ControllerParameters
    tasks: tuple[TaskTiming, ...]
    make: Callable[[], Program]
    loaded: LoadedController | None = None
    times: TickTimes = field(default_factory=TickTimes)

    @property
    def tunable(self) -> tuple[Parameter, ...]:
        """The parameters that its programs take over during a run; none if another takes over."""
        if parse_succession(self.parameters.changes):
            return ()
        return tunable_of(self.parameters, self.loaded)

    def check(self, parameters: ControllerParameters) -> None:
        """Raise BallbotError if its programs can't take over the values of these parameters."""
        _check_tuned(self.parameters, parameters, self.loaded)

    def changed(
        self, parameters: ControllerParameters, values: Mapping[str, object]
    ) -> ControllerParameters:
        """Return parameters with other values for some; ParameterError if they can't change."""
        return changed_parameters(parameters, values, self.loaded)


def tunable_of(
    parameters: ControllerParameters, loaded: LoadedController | None
) -> tuple[Parameter, ...]:
    """Return the parameters that a program takes over during a run."""
    if loaded is not None:
        rows = [parameters_of(CONTROLLER)[name] for name in loaded.cls.tunable_settings]
        rows += own_rows(loaded)
    elif parameters.implementation == 'python':
        rows = list(parameters_of(CONTROLLER).values())
    else:  # the gains are constants of the C code
        rows = []
    return tuple(row for row in rows if row.is_live)


def changed_parameters(
    parameters: ControllerParameters, values: Mapping[str, object], loaded: LoadedController | None
) -> ControllerParameters:
    """Return the parameters of a run in which some change; ParameterError if they can't."""
    rows = {row.name: row for row in tunable_of(parameters, loaded)}
    for name in values:
        if name not in rows:
            raise ParameterError(
                f"{CONTROLLER}.{name} can't change during a run of "
                f'{public_reference(parameters.implementation)}; {suggest(name, rows)}'
            )
    after = parameters.with_values(
        {name: rows[name].check(value, f'{CONTROLLER}.') for name, value in values.items()}
    )
    _check_tuned(parameters, after, loaded)
    return after


def _check_tuned(
    before: ControllerParameters, after: ControllerParameters, loaded: LoadedController | None
) -> None:
    """Raise BallbotError if a controller can't take over the values of these parameters."""
    if loaded is None:
        return
    old, new = before.values(), after.values()
    for row in tunable_of(before, loaded):
        if _count(new[row.name]) != _count(old[row.name]):
            raise ParameterError(
                f'{CONTROLLER}.{row.name}: {short_repr(new[row.name])} is not a list of '
                f'{_count(old[row.name])} numbers'
            )
    user_parameters(loaded, after)


def _count(value: Value) -> int:
    """Return how many values a parameter has."""
    return len(value) if isinstance(value, tuple) else 1


def compose_controller(
    parameters: ParameterSet, given: LoadedController | None = None
) -> LoadedController | None:
    """Prepare the controller of a run: load its class, check its parameters, and design its gains.

    The path of its file becomes absolute. A class that is given instead of a reference is not
    loaded. The result is None for the document's program.

    It raises BallbotError if it can't run here, its class or its parameters are not valid, or the
    design fails.
    """
    reference = parameters.of(ControllerParameters).implementation
    if reference in DOCUMENTS_PROGRAM:
        require_implementation(reference)
        parameters.declare_own(reference, ())
        settings = parameters.of(ControllerParameters)
        check_load(settings)
        faults_of(settings, TASK_NUMBERS)
        check_times_of(settings, None)
        _check_changes(settings, None)
        _compose_successor(parameters)
        return None
    if given is None:
        reference = resolve_reference(reference, Path.cwd())
        parameters.set(CONTROLLER, 'implementation', reference)
    loaded = given or load_controller(reference)
    parameters.declare_own(loaded.cls.__name__, own_rows(loaded))
    design(loaded, parameters)
    check_times_of(parameters.of(ControllerParameters), loaded)
    _compose_successor(parameters)
    # Create an instance, so that most mistakes are found before the run.
    implementation_for(parameters.of(ControllerParameters), loaded).make()
    _check_changes(parameters.of(ControllerParameters), loaded)
    return loaded


def successor_of(parameters: ControllerParameters) -> tuple[float, ControllerParameters] | None:
    """Return when another controller takes over [s], and its parameters; None if none does."""
    after = parse_succession(parameters.changes)
    if after is None:
        return None
    own = tuple((name, value) for name, value in after.values.items() if is_own(name))
    values = {IMPLEMENTATION: after.values[IMPLEMENTATION], 'changes': ''}
    return after.time, replace(parameters, own=own).with_values(values)


def public_changes(changes: str) -> str:
    """Return the text of the parameter `changes` without a path on this machine."""
    return with_successor(changes, public_reference)


def with_successor(changes: str, reference_for: Callable[[str], str]) -> str:
    """Return the text of the parameter `changes` with another reference to the controller."""
    after = parse_succession(changes)
    if after is None:
        return changes
    reference = reference_for(str(after.values[IMPLEMENTATION]))
    replaced = after._replace(values={**after.values, IMPLEMENTATION: reference})
    return changes_text([*parse_changes(changes), replaced])


def _compose_successor(parameters: ParameterSet) -> None:
    """Check and design the controller that takes over, if any; its values go into `changes`."""
    settings = parameters.of(ControllerParameters)
    after = parse_succession(settings.changes)
    if after is None:
        return
    composed = ParameterSet()
    for node, name, value in parameters:
        if not is_own(name):
            composed.set(node, name, value)
    for name, value in {'changes': '', **after.values}.items():
        composed.set(CONTROLLER, name, value)
    compose_controller(composed)
    found = composed.of(ControllerParameters)
    values = {IMPLEMENTATION: found.implementation, **dict(found.own)}
    changes = changes_text([*parse_changes(settings.changes), after._replace(values=values)])
    parameters.set(CONTROLLER, 'changes', changes)


def _check_changes(parameters: ControllerParameters, loaded: LoadedController | None) -> None:
    for each in parse_changes(parameters.changes):
        parameters = changed_parameters(parameters, each.values, loaded)


def processor_load(p: Any, own_tasks: Sequence[TaskTiming] = ()) -> tuple[Any, Any]:
    """Return the shares of the processor that interrupts and tasks take.

    Parameters
    ----------
    p : row or namespace
        Parameters of ``controller``; they may be columns.
    own_tasks : sequence of TaskTiming
        Those of a controller other than the document's.
    """
    if not own_tasks:
        return interrupt_load(p), task_load(p)
    periods_us = [1000.0 * each.period_ms for each in own_tasks if each.name != IDLE]
    return interrupt_load(p), sum(load_of(p, 0.0, p.tick_time, each) for each in periods_us)


def check_load(p: Any, own_tasks: Sequence[TaskTiming] = ()) -> None:
    """Raise ParameterError if the processor can't bear interrupts and tasks.

    The parameters are as for :func:`processor_load`.
    """
    of_interrupts, of_tasks = processor_load(p, own_tasks)
    if not p.kernel:
        return
    if p.link_time > p.interrupt_time:
        raise ParameterError(f'{CONTROLLER}.link_time: longer than interrupt_time')
    if of_interrupts + of_tasks > 1.0:
        raise ParameterError(
            f'{CONTROLLER}: at {p.processor_clock:g} MHz the interrupts need {of_interrupts:.0%} '
            f'of the processor and the tasks {of_tasks:.0%}, together more than 100 %'
        )


def check_times_of(p: ControllerParameters, loaded: LoadedController | None) -> None:
    """Raise ParameterError if the times of the tasks are those of another program."""
    if not p.times_of:
        return
    if loaded:
        own = loaded.code.source.sha256
    else:
        from ballbot_ros.controllers.codegen.application import program_sha256

        own = program_sha256()
    if not own.startswith(p.times_of):
        raise ParameterError(
            f'{CONTROLLER}.times_of: {p.times_of} is another program than '
            f'{loaded.code.shown if loaded else "the document"}, which is {own[:16]}'
        )


def implementation_for(
    parameters: ControllerParameters, loaded: LoadedController | None = None
) -> Implementation:
    """Return the implementation that the parameters select.

    C is generated and compiled once, here; each program is then a separate process. `loaded` is the
    selected class, if it has been loaded.

    Raises
    ------
    CodegenError
        If a tool is missing or the C does not build.
    ControllerError, ParameterError
        If the class of a controller can't be loaded, or its gains have not been designed.
    """
    first = _implementation(parameters, loaded)
    successor = successor_of(parameters)
    if successor is None:
        return first
    second, at_ms = implementation_for(successor[1]), round(successor[0] * 1000.0)
    return replace(first, make=lambda: HandedOver(first.make(), second.make(), at_ms))


def _implementation(
    parameters: ControllerParameters, loaded: LoadedController | None
) -> Implementation:
    if parameters.implementation not in DOCUMENTS_PROGRAM:
        return _controller(parameters, loaded or load_controller(parameters.implementation))
    tasks = task_timings(parameters.ts2_period, parameters.ts3_period)
    check_load(parameters)
    faults_of(parameters, TASK_NUMBERS)
    if parameters.implementation == 'python':
        return Implementation(parameters, tasks, lambda: ControlProgram(parameters))
    return Implementation(parameters, tasks, _compiled(parameters))


def _controller(parameters: ControllerParameters, loaded: LoadedController) -> Implementation:
    if missing := missing_design(parameters, own_rows(loaded)):
        raise ParameterError(f'{CONTROLLER}.{missing[0]}: {NOT_DESIGNED}')
    user, model = user_parameters(loaded, parameters), design_model(parameters)
    check_load(parameters, loaded.tasks)
    faults_of(parameters, [each.name for each in loaded.tasks])
    times = TickTimes()
    return Implementation(
        parameters,
        tuple(loaded.tasks),
        lambda: ControllerProgram(loaded, user, model, parameters, times),
        loaded,
        times,
    )


def _compiled(parameters: ControllerParameters) -> Callable[[], Program]:
    from ballbot_ros.controllers.codegen.application import read_tasks, write_application
    from ballbot_ros.controllers.codegen.programs import BALANCE
    from ballbot_ros.controllers.codegen.toolchain import TARGETS, build
    from ballbot_ros.files import temporary_folder

    scratch = temporary_folder()
    folder = Path(scratch.name) / 'application'
    write_application(folder, parameters)
    target = TARGETS[parameters.implementation]
    command = build(folder, target, Path(scratch.name) / 'build')
    tasks = read_tasks(folder)

    def make() -> Program:
        # Refer to `scratch`, so that its folder exists as long as programs may be created.
        assert scratch
        return BALANCE.start(command, tasks, parameters)

    return make


class HandedOver:
    """Two programs that both run on the same samples; the motors follow the first, then the second.

    So the second has calibrated its gyros and knows the robot when it takes over, `at_ms` after the
    start of the run. The tasks, and their times on the brick, remain those of the first.
    """

    def __init__(self, first: Program, second: Program, at_ms: int) -> None:
        self._first, self._second, self._at_ms = first, second, at_ms
        self._schedule = Schedule(second.tasks)
        self._start_ms: int | None = None
        self._outputs = DeviceOutputs((0, 0))
        self.tasks = first.tasks
        self._publish(first)

    def _publish(self, in_command: Program) -> None:
        self.x: PlaneEstimates = in_command.x
        self.y: PlaneEstimates = in_command.y
        self.operating_state = in_command.operating_state

    def retune(self, parameters: ControllerParameters) -> None:
        """Let the first program take over parameters."""
        self._first.retune(parameters)

    def restart(self) -> None:
        """Start both programs anew."""
        self._first.restart()
        self._second.restart()

    def run(
        self, tasks: Sequence[str], systick_ms: int, inputs: DeviceInputs, flags: int = 0
    ) -> DeviceOutputs:
        """Run the tasks with these names, and once in a tick the second program."""
        outputs = self._first.run(tasks, systick_ms, inputs, flags)
        if self._start_ms is None:
            self._start_ms = systick_ms
        elapsed_ms = (systick_ms - self._start_ms) & UINT32_MASK
        if not flags & SAME_TICK:
            due = self._schedule.due(elapsed_ms)
            self._outputs = self._second.run(due, systick_ms, inputs)
        is_first = elapsed_ms < self._at_ms
        self._publish(self._first if is_first else self._second)
        return outputs if is_first else self._outputs

    def job_time(self, task: str, outputs: DeviceOutputs, times: JobTimes) -> float:
        """Return how long the job of the first program takes that has just run [µs]."""
        return self._first.job_time(task, outputs, times)
