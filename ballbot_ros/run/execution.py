"""Execution of a run, from its specification to its result, and the folder of its files."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import replace
from datetime import datetime
from pathlib import Path
from typing import NamedTuple

from ballbot_ros.analysis.drawing import draw_motion
from ballbot_ros.analysis.figure_parts import png_of
from ballbot_ros.analysis.metrics import judge, judge_property, measure
from ballbot_ros.analysis.recorded_scenario import fault_intervals, scheduled_pushes
from ballbot_ros.analysis.run_data import RunData, read_run
from ballbot_ros.analysis.signals import motion_signals
from ballbot_ros.engine.scenario.properties import Course
from ballbot_ros.errors import BallbotError, RecordingError
from ballbot_ros.files import make_folder, temporary_folder
from ballbot_ros.lockstep.run_actions import Outcome
from ballbot_ros.nodes.middleware import require_middleware
from ballbot_ros.parameters import RECORDER, ControllerParameters
from ballbot_ros.process import DeferredSignals
from ballbot_ros.robot.brick.job_times import is_timed
from ballbot_ros.robot.world.clearance import NO_WALLS
from ballbot_ros.robot.world.world import World
from ballbot_ros.run.node_process import ForkClient
from ballbot_ros.run.observer import LogObserver, RunObserver
from ballbot_ros.run.requirements import OR_NONE, Processes, require_rclpy
from ballbot_ros.run.result import RunResult
from ballbot_ros.run.spec import RunSpec


class OutputFiles(NamedTuple):
    """The output files of a run."""

    recording: Path | None = None
    figure: Path | None = None


@contextmanager
def output_files(spec: RunSpec) -> Iterator[OutputFiles]:
    """Create the folder of a run; remove it in the end if it is still empty.

    It raises BallbotError if the folder is not writable, or has a recording of this name.
    """
    if spec.output is None and not spec.record:
        yield OutputFiles()
        return
    folder = spec.output or _new_folder(spec.name)
    if spec.output is not None:
        try:
            make_folder(folder)
        except OSError as error:
            is_file = isinstance(error, FileExistsError | NotADirectoryError)
            problem = 'not a folder; choose another --output' if is_file else error.strerror
            raise BallbotError(f'--output {folder}: {problem}') from None
    try:
        recording = folder / f'{spec.name}.mcap' if RECORDER in spec.nodes else None
        if recording and recording.exists():
            raise BallbotError(f'{recording}: already exists; choose another --output')
        yield OutputFiles(recording, folder / f'{spec.name}.png')
    finally:
        # A disk that has failed in the meantime must not hide the result.
        with suppress(OSError):
            if not any(folder.iterdir()):
                folder.rmdir()


def _new_folder(name: str) -> Path:
    stem = f'{datetime.now():%Y-%m-%d_%H-%M-%S}_{name}'
    for suffix in ('', *(f'_{number}' for number in range(2, 1000))):
        folder = Path('runs') / (stem + suffix)
        try:
            folder.mkdir(parents=True)
        except FileExistsError:
            continue
        except OSError as error:
            raise BallbotError(f'{folder}: {error.strerror}') from None
        return folder
    raise BallbotError(f'runs/{stem}: already exists')


def execute(
    spec: RunSpec,
    observer: RunObserver | None = None,
    is_replaced: Callable[[], bool] = lambda: False,
    client: ForkClient | None = None,
    *,
    starts_paused: bool = False,
    on_judged: Callable[[RunResult], None] = lambda result: None,
) -> RunResult:
    """Run a scenario, measure and judge it, and draw its figure.

    It raises BallbotError if the run can't start: no ROS, another plant in the ROS domain, or a
    folder or file that can't be written.

    Parameters
    ----------
    observer : RunObserver or None
        Receives progress and notices; None for an observer that logs the notices.
    is_replaced : callable
        Returns whether another run replaces this one; only for nodes in separate processes.
    client : ForkClient or None
        Forks the nodes that are separate processes. One that was started early has already imported
        them; None to start one for this run.
    starts_paused : bool
        Whether the run waits at its first tick for ``plant_sim/start``; only for nodes in separate
        processes.
    on_judged : callable
        Receives the result before its figure is drawn, which takes a second.

    Returns
    -------
    RunResult
        The result, also of a run that failed or was interrupted.
    """
    # Read the map before the run: its file may change in the meantime.
    world = World.of(spec.plant)
    with output_files(spec) as files:
        result = _carry_out(
            spec,
            files.recording,
            observer or LogObserver(),
            is_replaced,
            client,
            starts_paused=starts_paused,
        )
        timed = _with_timing(spec, result, files.recording)
        result = _with_metrics(spec, world, timed, files.recording)
        with suppress(OSError):
            if files.recording and files.recording.exists():
                result = replace(result, recording=files.recording)
        on_judged(result)
        # An interrupted run needs no figure; the recording has everything.
        if files.figure and result.outcome is not Outcome.STOPPED:
            result = _with_figure(spec, world, result, files.figure)
    return result


def _carry_out(
    spec: RunSpec,
    recording: Path | None,
    observer: RunObserver,
    is_replaced: Callable[[], bool],
    client: ForkClient | None,
    *,
    starts_paused: bool,
) -> RunResult:
    # Import only what these processes need: without ROS there is no rclpy.
    if spec.processes is Processes.NONE:
        with DeferredSignals():
            from ballbot_ros.run.offline import run_offline

        return run_offline(spec, recording, observer)
    with temporary_folder() as folder, ExitStack() as stack:
        scratch = Path(folder)
        if spec.processes is Processes.ONE:
            with DeferredSignals():
                require_rclpy(OR_NONE)
                from ballbot_ros.run.one_process import run_in_one_process

            return run_in_one_process(spec, recording, scratch, observer)
        client = client or stack.enter_context(ForkClient())
        require_middleware()
        with DeferredSignals():
            from ballbot_ros.run.separate_processes import run_in_separate_processes

        return run_in_separate_processes(
            client, spec, recording, scratch, observer, is_replaced, starts_paused=starts_paused
        )


def _with_timing(spec: RunSpec, result: RunResult, recording: Path | None) -> RunResult:
    """Return the result with the timing of the tasks; the plant in a graph does not know it."""
    trajectory, controller = result.trajectory, spec.parameters.of(ControllerParameters)
    if trajectory and recording and is_timed(controller) and not len(trajectory.timing):
        with suppress(RecordingError):
            timing = read_run(recording).trajectory.timing
            return replace(result, trajectory=replace(trajectory, timing=timing))
    return result


def _with_metrics(
    spec: RunSpec, world: World | None, result: RunResult, recording: Path | None
) -> RunResult:
    """Return the result with metrics, judged expectations and properties."""
    if result.trajectory is None:
        return result
    walls = world.walls if world else NO_WALLS

    def read() -> RunData | None:
        with suppress(RecordingError):
            return read_run(recording) if recording else None
        return None

    scenario = spec.scenario
    outside = [(each.start, each.end) for each in result.external_pushes]
    pushes = sorted([*scenario.events['push'], *outside])
    course = Course(
        {**scenario.events, 'push': pushes}, spec.parameters.of(ControllerParameters).mode
    )
    signals = motion_signals(result.trajectory, walls, read)
    return replace(
        result,
        metrics=measure(result.trajectory, spec.plant, walls),
        judgements=judge(scenario.expectations, result.trajectory, spec.plant, walls),
        properties=[
            judge_property(each, signals, spec.plant, course) for each in scenario.properties
        ],
    )


def _with_figure(spec: RunSpec, world: World | None, result: RunResult, path: Path) -> RunResult:
    """Draw the figure, if there is anything to show."""
    if result.trajectory is None or not len(result.trajectory.time):
        return result
    scenario = spec.scenario
    controller = f', {spec.controller.cls.__name__}' if spec.controller else ''
    try:
        figure = draw_motion(
            result.trajectory,
            f'{scenario.name}{controller}: {scenario.purpose}',
            spec.plant.hold_time,
            scenario.segments,
            world.map if world else None,
            [
                *(push.interval for push in (*result.external_pushes, *scheduled_pushes(scenario))),
                *(mark for each in result.properties for mark in each.marks),
                *fault_intervals(spec.parameters, float(result.trajectory.time[-1])),
            ],
            spec.earlier,
        )
        path.write_bytes(png_of(figure))
    except OSError as error:
        with suppress(OSError):
            path.unlink()
        return replace(result, figure_failure=f'{path}: {error.strerror}')
    return replace(result, figure=path)
