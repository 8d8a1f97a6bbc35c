"""From the specification of a run to its result."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

from ballbot_ros.analysis.figures import draw_motion
from ballbot_ros.analysis.metrics import judge, measure
from ballbot_ros.files import temporary_folder
from ballbot_ros.parameters import PLANT, ParameterError
from ballbot_ros.run.observer import LogObserver, RunObserver
from ballbot_ros.run.output_folder import output_files
from ballbot_ros.run.requirements import require_rclpy
from ballbot_ros.run.result import RunResult
from ballbot_ros.run.spec import Processes, RunSpec
from ballbot_ros.simulation.outcome import Outcome
from ballbot_ros.world.world import World


def _never() -> bool:
    return False


def execute(
    spec: RunSpec,
    observer: RunObserver | None = None,
    is_replaced: Callable[[], bool] = _never,
) -> RunResult:
    """Run a scenario, measure and judge it, and draw its picture.

    Parameters
    ----------
    spec : RunSpec
    observer : RunObserver or None
        Is told of progress and incidents; None for one that logs the incidents.
    is_replaced : callable
        Whether another run is to take the place of this one, for nodes in separate processes.

    Returns
    -------
    RunResult
        Also of a run that failed or was interrupted.

    Raises
    ------
    BallbotError
        If the run can't begin: a duration of 0 s, no ROS, another plant in the ROS domain, a
        folder or file that can't be written.
    """
    if spec.plant.duration == 0.0:
        raise ParameterError(f'{PLANT}.duration is 0: a run of a scenario lasts longer than 0 s')
    with output_files(spec) as files:
        result = _carry_out(spec, files.recording, observer or LogObserver(), is_replaced)
        result = _judged(spec, result)
        if files.recording and files.recording.exists():
            result = replace(result, recording=files.recording)
        # Whoever interrupts a run wants it to end; the recording has everything.
        if files.picture and result.outcome is not Outcome.STOPPED:
            result = _with_picture(spec, result, files.picture)
    return result


def _carry_out(
    spec: RunSpec, recording: Path | None, observer: RunObserver, is_replaced: Callable[[], bool]
) -> RunResult:
    # Each way has imports of its own: without ROS there is no rclpy to import.
    if spec.processes is Processes.NONE:
        from ballbot_ros.run.offline import run_offline

        return run_offline(spec, recording, observer)
    require_rclpy(', or use --processes none')
    with temporary_folder() as folder:
        scratch = Path(folder)
        if spec.processes is Processes.ONE:
            from ballbot_ros.run.one_process import run_in_one_process

            return run_in_one_process(spec, recording, scratch, observer)
        from ballbot_ros.run.separate_processes import run_in_separate_processes

        return run_in_separate_processes(spec, recording, scratch, observer, is_replaced)


def _judged(spec: RunSpec, result: RunResult) -> RunResult:
    """Return the result with metrics, and expectations judged by them."""
    if result.trajectory is None:
        return result
    world = World.of(spec.plant)
    clearance = world.clearance if world and world.map.walls.any() else None
    return replace(
        result,
        metrics=measure(result.trajectory, spec.plant, clearance),
        judgements=judge(spec.scenario.expectations, result.trajectory, spec.plant, clearance),
    )


def _with_picture(spec: RunSpec, result: RunResult, path: Path) -> RunResult:
    """Draw the picture, if there is anything to be seen."""
    if result.trajectory is None or not len(result.trajectory.time):
        return result
    scenario, world = spec.scenario, World.of(spec.plant)
    try:
        draw_motion(
            result.trajectory,
            path,
            f'{scenario.name}: {scenario.purpose}',
            spec.plant.hold_time,
            (*scenario.vertical.segments, *scenario.horizontal.segments),
            world.map if world else None,
        )
    except OSError as error:
        with suppress(OSError):
            path.unlink()
        return replace(result, picture_failure=f'{path}: {error.strerror}')
    return replace(result, picture=path)
