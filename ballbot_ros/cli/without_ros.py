"""Runs a scenario in this process, without ROS."""

from __future__ import annotations

import time
from dataclasses import replace

from ballbot_ros.cli.experiment import Experiment
from ballbot_ros.cli.progress import Progress
from ballbot_ros.messages.simulated_recording import SimulatedRecording
from ballbot_ros.parameters import PlantParameters
from ballbot_ros.recording.errors import RecordingError
from ballbot_ros.simulation.closed_loop import ClosedLoop
from ballbot_ros.simulation.outcome import Outcome
from ballbot_ros.simulation.pacer import Pacer
from ballbot_ros.simulation.run_result import RunResult
from ballbot_ros.simulation.timing import FIRST_TICK_NS, SECOND_NS, TICK_NS
from ballbot_ros.simulation.trajectory import TrajectoryLog
from ballbot_ros.stop_request import StopRequest


def run_without_ros(experiment: Experiment, progress: Progress) -> RunResult:
    """Run the closed loop, recorded as the graph would be."""
    plant = experiment.parameters.of(PlantParameters)
    ticks = round(plant.duration * SECOND_NS) // TICK_NS
    factor = plant.real_time_factor
    loop = ClosedLoop(experiment.parameters, experiment.scenario)
    log, pacer = TrajectoryLog(), Pacer()
    recording = _recording(experiment, loop)
    begun = time.monotonic()

    def result_so_far(failure: str) -> RunResult:
        outcome = Outcome.STOPPED if stop.signal else Outcome.COMPLETED
        return RunResult(
            outcome=Outcome.FAILED if failure else outcome,
            reason=failure,
            exit_status=128 + stop.signal if stop.signal else 1,
            ticks=log.ticks,
            duty_sha256=log.duty_sha256,
            real_time_factor=log.ticks * TICK_NS / SECOND_NS / (time.monotonic() - begun),
            late_ticks=pacer.late_ticks,
            resends=0,
        )

    with StopRequest() as stop:
        try:
            while log.ticks < ticks and not stop.signal and not loop.plant.stopped:
                _await_tick(pacer, factor)
                tick = loop.tick()
                log.add(tick.truth, *tick.outputs.duty)
                if recording:
                    recording.add(tick, loop.program)
                progress.update(log.ticks * TICK_NS / SECOND_NS)
            hit = str(loop.plant.newest_hit) if loop.plant.stopped else ''
            if hit:
                progress.notice(hit)
            result = result_so_far(hit)
            if recording:
                last_ns = loop.plant.time_ns - TICK_NS
                if hit:
                    last_ns = loop.plant.time_ns
                    recording.add_truth(loop.plant.truth(), wall_hit=loop.plant.wall_hit)
                if result.outcome is not Outcome.COMPLETED:
                    recording.stop_motors(last_ns)
                recording.close(result)
        except RecordingError as error:
            result = result_so_far(str(error))
            progress.notice(str(error))
    return replace(result, trajectory=log.trajectory())


def _await_tick(pacer: Pacer, factor: float) -> None:
    if delay_s := pacer.delay_s(factor, time.monotonic()):
        time.sleep(delay_s)
    pacer.ticked(factor, time.monotonic())


def _recording(experiment: Experiment, loop: ClosedLoop) -> SimulatedRecording | None:
    if experiment.recording is None:
        return None
    ball_radius = experiment.parameters.of(PlantParameters).ball_radius
    recording = SimulatedRecording(experiment.recording, experiment.attachments, ball_radius)
    recording.begin(FIRST_TICK_NS, loop.world, loop.pushes)
    return recording
