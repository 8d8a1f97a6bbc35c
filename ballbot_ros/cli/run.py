"""`ballbot run`: from a scenario to a verdict."""

from __future__ import annotations

import os
import platform
import sys
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from datetime import datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import yaml

from ballbot_ros import __version__
from ballbot_ros.analysis.figures import draw_motion
from ballbot_ros.analysis.metrics import Judgement, judge, measure
from ballbot_ros.cli.progress import Progress
from ballbot_ros.cli.result import STOPPED, Result, Verdict, print_json, print_table
from ballbot_ros.errors import BallbotError
from ballbot_ros.parameter_file import format_parameters
from ballbot_ros.parameters import GAMEPAD, GYRO, PLANT, ParameterError, ParameterSet
from ballbot_ros.scenario.library import load_scenario
from ballbot_ros.scenario.scenario import Scenario
from ballbot_ros.simulation.pacer import SLOWEST
from ballbot_ros.simulation.trajectory import Trajectory

RECORDED_VERSIONS = ('numpy', 'scipy', 'control', 'mcap', 'ros-rclpy', 'ros-rmw-fastrtps-cpp')


@dataclass
class Experiment:
    """A run as it is to be made.

    Attributes
    ----------
    scenario : Scenario
    reference : str
        Name or path by which the nodes load the scenario.
    parameters : ParameterSet
    recording : Path or None
        The file to write.
    attachments : dict
        Files that make the recording enough to run it again, by name.
    """

    scenario: Scenario
    reference: str
    parameters: ParameterSet
    recording: Path | None
    attachments: dict[str, bytes] = field(default_factory=dict)


@dataclass
class Finished:
    """What a way of running hands back.

    Attributes
    ----------
    summary : dict
        The plant's own account: outcome, reason, ticks, duty_sha256 and measurements.
    trajectory : Trajectory or None
        None where the plant died.
    """

    summary: dict[str, Any]
    trajectory: Trajectory | None


def run_scenario(
    reference: str,
    *,
    processes: str,
    real_time_factor: float | None,
    output: Path | None,
    seed: int | None,
    record: bool,
    assignments: Sequence[str],
    as_json: bool,
) -> int:
    """Run a scenario as the command line says, print its result, return the exit status."""
    scenario = load_scenario(reference)
    parameters = ParameterSet()
    parameters.update(scenario.parameters)
    if real_time_factor is not None and 0.0 < real_time_factor < SLOWEST:
        raise ParameterError(f'--real-time-factor {real_time_factor}: 0, or {SLOWEST} and more')
    if real_time_factor is None and not parameters.is_set(PLANT, 'real_time_factor'):
        real_time_factor = 0.0
    if real_time_factor is not None:
        parameters.set(PLANT, 'real_time_factor', real_time_factor)
    if seed is not None:
        parameters.set(GYRO, 'seed', seed, '--seed')
    for assignment in assignments:
        _assign(parameters, assignment)
    if '/' in reference or reference.endswith(('.yaml', '.yml')):
        reference = str(Path(reference).resolve())
    parameters.set(GAMEPAD, 'scenario', reference)

    folder = output
    if folder is None and record:
        folder = _new_folder(scenario.name)
    elif folder is not None:
        _make_folder(folder)
    recording = folder / f'{scenario.name}.mcap' if folder and record else None
    if recording and recording.exists():
        raise BallbotError(f'{recording}: exists already; choose another --output')
    experiment = Experiment(scenario, reference, parameters, recording)
    experiment.attachments = _attachments(experiment)

    plant_values = parameters.values(PLANT)
    duration = plant_values['duration']
    with ExitStack() as stack:
        scratch = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix='ballbot_')))
        progress = stack.enter_context(Progress(scenario.name, duration))
        stack.enter_context(_stdout_to_stderr())
        finished = _run(processes, experiment, scratch, progress)

    summary = finished.summary
    metrics: dict[str, float] = {}
    judgements: list[Judgement] = []
    if finished.trajectory:
        metrics = measure(finished.trajectory, plant_values)
        judgements = judge(scenario.expectations, finished.trajectory, plant_values)
    result = Result(
        scenario=scenario.name,
        processes=processes,
        seed=int(parameters.values(GYRO)['seed']),
        recording=recording if recording and recording.exists() else None,
        figure=None,
        metrics=metrics,
        verdict=Verdict.of(summary, judgements),
        summary=summary,
        judgements=judgements,
    )
    # Who interrupts a run wants it to end; the recording has everything.
    if folder and finished.trajectory and result.verdict.outcome != STOPPED:
        figure = folder / f'{scenario.name}.png'
        title = f'{scenario.name}: {scenario.purpose}'
        try:
            segments = (*scenario.vertical.segments, *scenario.horizontal.segments)
            draw_motion(finished.trajectory, figure, title, plant_values['hold_time'], segments)
            result.figure = figure
        except OSError as error:
            figure.unlink(missing_ok=True)
            result.verdict = result.verdict.without_picture(f'{figure}: {error.strerror}')
    (print_json if as_json else print_table)(result)
    return result.verdict.exit_status


def _run(processes: str, experiment: Experiment, scratch: Path, progress: Progress) -> Finished:
    # Each way has imports of its own: without ROS there is no rclpy to import.
    if processes == 'none':
        from ballbot_ros.cli.without_ros import run_without_ros

        return run_without_ros(experiment, progress)
    require_rclpy(', or use --processes none')
    if processes == 'one':
        from ballbot_ros.cli.one_process import run_in_one_process

        return run_in_one_process(experiment, scratch, progress)
    from ballbot_ros.cli.separate_processes import run_in_separate_processes

    return run_in_separate_processes(experiment, scratch, progress)


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


def require_rclpy(otherwise: str = '') -> None:
    """Raise BallbotError where there is no ROS."""
    try:
        import rclpy  # noqa: F401
    except ImportError as error:
        raise BallbotError(
            f'ROS 2 is not there ({error}): source ROS 2 Jazzy, install '
            f'"ballbot_ros[ros]"{otherwise}'
        ) from None


def _assign(parameters: ParameterSet, assignment: str) -> None:
    target, equals, text = assignment.partition('=')
    node, dot, name = target.partition('.')
    if not (equals and dot and node and name):
        raise ParameterError(f'--set {assignment}: not of the form node.param=value')
    try:
        value = yaml.safe_load(text)
    except yaml.YAMLError:
        value = text
    parameters.set(node, name, value, f'--set {assignment}')


def _make_folder(folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
        probe = folder / '.ballbot_probe'
        probe.touch()
        probe.unlink()
    except OSError as error:
        raise BallbotError(f'--output {folder}: {error.strerror}') from None


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
    raise BallbotError(f'runs/{stem}: exists already')


def _attachments(experiment: Experiment) -> dict[str, bytes]:
    versions = {'ballbot_ros': __version__, 'python': platform.python_version()}
    for package in RECORDED_VERSIONS:
        try:
            versions[package] = version(package)
        except PackageNotFoundError:
            continue
    # The scenario is attached itself; where its file lies on this machine is nobody's business.
    parameters = ParameterSet()
    parameters.update(experiment.parameters)
    parameters.set(GAMEPAD, 'scenario', '')
    return {
        'scenario.yaml': experiment.scenario.text.encode(),
        'parameters.yaml': format_parameters(parameters).encode(),
        'versions.yaml': yaml.safe_dump(versions, sort_keys=False).encode(),
    }
