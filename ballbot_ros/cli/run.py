"""`ballbot run`: from a scenario to a verdict."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import click

from ballbot_ros.analysis.figures import draw_motion
from ballbot_ros.analysis.metrics import Judgement, judge, measure
from ballbot_ros.cli.experiment import (
    Experiment,
    Processes,
    assign,
    attachments_of,
    output_of,
    settle_map,
    tidied,
)
from ballbot_ros.cli.options import set_option
from ballbot_ros.cli.path_types import PATH
from ballbot_ros.cli.progress import Progress
from ballbot_ros.cli.requirements import require_rclpy
from ballbot_ros.cli.result import Result, Verdict, print_json, print_table
from ballbot_ros.codegen.implementation import require_implementation
from ballbot_ros.files import temporary_folder
from ballbot_ros.parameters import (
    CONTROLLER,
    GAMEPAD,
    GYRO,
    PLANT,
    SUPERVISOR,
    ControllerParameters,
    GyroParameters,
    ParameterError,
    ParameterSet,
    PlantParameters,
)
from ballbot_ros.scenario.library import load_scenario
from ballbot_ros.scenario.scenario import Scenario
from ballbot_ros.simulation.outcome import Outcome
from ballbot_ros.simulation.run_result import RunResult


@dataclass(frozen=True)
class RunOptions:
    """What the command line says of a run, whatever its scenario.

    Attributes
    ----------
    processes : Processes
    real_time_factor : float or None
        None: what the scenario says, else 1 to be looked at and 0 otherwise.
    output : Path or None
        Folder for the recording; None for a new one.
    seed : int or None
        None: what the scenario says.
    record : bool
    assignments : sequence of str
        Values of parameters, as `node.param=value`.
    controller : str or None
        What computes; None: what the scenario says.
    viewer : bool
        Whether it is shown in a browser.
    as_json : bool
        Whether the result is printed as JSON.
    """

    processes: Processes
    real_time_factor: float | None
    output: Path | None
    seed: int | None
    record: bool
    assignments: Sequence[str]
    controller: str | None
    viewer: bool
    as_json: bool


def parameters_of_run(scenario: Scenario, reference: str, options: RunOptions) -> ParameterSet:
    """Return the parameters of a run.

    Raises
    ------
    ParameterError
        If an option or an assignment is not allowed.
    """
    parameters = ParameterSet()
    parameters.update(scenario.parameters)
    real_time_factor = options.real_time_factor
    if real_time_factor is None and not parameters.is_set(PLANT, 'real_time_factor'):
        real_time_factor = 1.0 if options.viewer else 0.0
    if real_time_factor is not None:
        parameters.set(PLANT, 'real_time_factor', real_time_factor, '--real-time-factor')
    if options.seed is not None:
        parameters.set(GYRO, 'seed', options.seed, '--seed')
    for assignment in options.assignments:
        assign(parameters, assignment)
    for node in (GAMEPAD, SUPERVISOR):
        if parameters.is_set(node, 'scenario'):
            raise ParameterError(f'{node}.scenario can not be set: the scenario is {reference}')
    if options.controller:
        parameters.set(CONTROLLER, 'implementation', options.controller, '--controller')
    if parameters.of(PlantParameters).duration == 0.0:
        raise ParameterError(f'--set {PLANT}.duration=0: a run of a scenario lasts longer than 0 s')
    if not parameters.is_set(GAMEPAD, 'device'):
        # Whatever lies plugged in must not disturb a scenario.
        parameters.set(GAMEPAD, 'device', '')
    return parameters


def run_scenario(
    reference: str, options: RunOptions, is_replaced: Callable[[], bool] = lambda: False
) -> int:
    """Run a scenario as the command line says, print its result, return the exit status.

    Parameters
    ----------
    reference : str
        Name or file of the scenario.
    options : RunOptions
    is_replaced : callable
        Whether another run is to take this one's place, of a graph of processes.
    """
    scenario = load_scenario(reference)
    parameters = parameters_of_run(scenario, reference, options)
    require_implementation(parameters.of(ControllerParameters).implementation)
    if '/' in reference or reference.endswith(('.yaml', '.yml')):
        reference = str(Path(reference).resolve())
    parameters.set(GAMEPAD, 'scenario', reference)
    world = settle_map(parameters)
    floor_map = world.map if world else None

    folder, recording = output_of(scenario.name, options.output, record=options.record)
    experiment = Experiment(scenario, reference, parameters, recording)
    experiment.attachments = attachments_of(experiment)

    plant = parameters.of(PlantParameters)
    duration = plant.duration
    with tidied(folder):
        with Progress(scenario.name, duration) as progress, _stdout_to_stderr():
            run = _run(options.processes, experiment, progress, is_replaced)

        trajectory = run.trajectory
        metrics: dict[str, float] = {}
        judgements: list[Judgement] = []
        if trajectory:
            clearance = world.clearance if world and world.map.walls.any() else None
            metrics = measure(trajectory, plant, clearance)
            judgements = judge(scenario.expectations, trajectory, plant, clearance)
        result = Result(
            scenario=scenario.name,
            processes=options.processes,
            seed=int(parameters.of(GyroParameters).seed),
            recording=recording if recording and recording.exists() else None,
            figure=None,
            metrics=metrics,
            verdict=Verdict.of(run, judgements),
            run=run,
            judgements=judgements,
        )
        # Who interrupts a run wants it to end; the recording has everything.
        if folder and trajectory and len(trajectory.time) and run.outcome is not Outcome.STOPPED:
            figure = folder / f'{scenario.name}.png'
            try:
                draw_motion(
                    trajectory,
                    figure,
                    f'{scenario.name}: {scenario.purpose}',
                    plant.hold_time,
                    (*scenario.vertical.segments, *scenario.horizontal.segments),
                    floor_map,
                )
                result.figure = figure
            except OSError as error:
                figure.unlink(missing_ok=True)
                result.verdict = result.verdict.without_picture(f'{figure}: {error.strerror}')
    (print_json if options.as_json else print_table)(result)
    return result.verdict.exit_status


def _run(
    processes: Processes,
    experiment: Experiment,
    progress: Progress,
    is_replaced: Callable[[], bool],
) -> RunResult:
    # Each way has imports of its own: without ROS there is no rclpy to import.
    if processes is Processes.NONE:
        from ballbot_ros.cli.without_ros import run_without_ros

        return run_without_ros(experiment, progress)
    require_rclpy(', or use --processes none')
    with temporary_folder() as folder:
        scratch = Path(folder)
        if processes is Processes.ONE:
            from ballbot_ros.cli.one_process import run_in_one_process

            return run_in_one_process(experiment, scratch, progress)
        from ballbot_ros.cli.separate_processes import run_in_separate_processes

        return run_in_separate_processes(experiment, scratch, progress, is_replaced)


@contextmanager
def _stdout_to_stderr() -> Iterator[None]:
    """Keep standard output for the result: the middleware prints its complaints there."""
    sys.stdout.flush()
    kept = os.dup(1)
    os.dup2(2, 1)
    try:
        yield
    finally:
        os.dup2(kept, 1)
        os.close(kept)


@click.command('run')
@click.argument('scenario')
@click.option(
    '--processes',
    type=click.Choice([each.value for each in Processes]),
    default=Processes.SEPARATE.value,
    show_default=True,
    help='Every node a process of its own; all nodes in one process; or no nodes at all, the same '
    'loop without ROS.',
)
@click.option(
    '--real-time-factor',
    type=click.FloatRange(0.0, 1000.0),
    help='Pace against the wall clock: 1 real time, 0.1 slow motion, 0 as fast as it can.  '
    '[default: 0, unless the scenario sets it]',
)
@click.option(
    '--output',
    type=PATH,
    help='Folder for recording and picture.  [default: runs/<date>_<scenario>]',
)
@click.option('--seed', type=click.IntRange(0), help='Seed of the device noise.')
@click.option('--no-record', is_flag=True, help='Write no recording.')
@set_option
@click.option(
    '--controller',
    type=click.Choice(['python', 'c', 'arm']),
    help='What computes: the Python program, the C generated from it, or that on an emulated ARM '
    'processor.  [default: python, unless the scenario sets it]',
)
@click.option(
    '--viewer',
    is_flag=True,
    help='Show the run in a browser, at factor 1 unless another is given; prints the address. The '
    'page stays after the run, for others to be chosen there.',
)
@click.option('--json', 'as_json', is_flag=True, help='Print one JSON object.')
def command(
    scenario: str,
    processes: str,
    real_time_factor: float | None,
    output: Path | None,
    seed: int | None,
    no_record: bool,
    assignments: tuple[str, ...],
    controller: str | None,
    viewer: bool,
    as_json: bool,
) -> int:
    """Run SCENARIO, a name or a YAML file, and judge it by its expectations.

    Exit status: 0 if the expectations hold, 1 if they do not or the run failed, 2 for a mistake
    in the arguments. With --viewer it is that of the last run.
    """
    options = RunOptions(
        processes=Processes(processes),
        real_time_factor=real_time_factor,
        output=output,
        seed=seed,
        record=not no_record,
        assignments=assignments,
        controller=controller,
        viewer=viewer,
        as_json=as_json,
    )
    if not viewer:
        return run_scenario(scenario, options)
    require_rclpy(', or leave out --viewer')
    from ballbot_ros.cli.viewer_session import run_with_viewer

    return run_with_viewer(scenario, options)
