"""Runs a scenario in this process, without ROS."""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path

from ballbot_ros.messages.run_summary import summary_json
from ballbot_ros.messages.simulated_recording import SimulatedRecording
from ballbot_ros.recording.errors import RecordingError
from ballbot_ros.run.attachments import attachments_of
from ballbot_ros.run.observer import RunObserver
from ballbot_ros.run.result import RunResult
from ballbot_ros.run.spec import RunSpec
from ballbot_ros.simulation.closed_loop import ClosedLoop
from ballbot_ros.simulation.outcome import Outcome
from ballbot_ros.simulation.pacer import Pacer
from ballbot_ros.simulation.run_actions import RunSummary
from ballbot_ros.simulation.timing import FIRST_TICK_NS, SECOND_NS, TICK_NS
from ballbot_ros.simulation.trajectory import TrajectoryLog
from ballbot_ros.stop_request import StopRequest


def run_offline(spec: RunSpec, recording: Path | None, observer: RunObserver) -> RunResult:
    """Run the closed loop, recorded as the graph would be."""
    loop = ClosedLoop(spec.parameters, spec.scenario)
    log, pacer = TrajectoryLog(), Pacer()
    writer = _begin_recording(spec, recording, loop)
    begun = time.monotonic()

    def summary(failure: str) -> RunSummary:
        outcome = Outcome.STOPPED if stop.signal else Outcome.COMPLETED
        return RunSummary(
            outcome=Outcome.FAILED if failure else outcome,
            reason=failure,
            ticks=log.ticks,
            duty_sha256=log.duty_sha256,
            real_time_factor=log.ticks * TICK_NS / SECOND_NS / (time.monotonic() - begun),
            late_ticks=pacer.late_ticks,
            resends=0,
            round_trips_s=(),
            start_ns=FIRST_TICK_NS,
        )

    with StopRequest() as stop:
        try:
            _tick_to_the_end(spec, loop, log, pacer, writer, observer, stop)
            hit = str(loop.plant.newest_hit) if loop.plant.stopped else ''
            if hit:
                observer.notice(hit)
            told = summary(hit)
            if writer:
                _end_recording(writer, loop, told)
        except RecordingError as error:
            told = summary(str(error))
            observer.notice(str(error))
    result = RunResult.from_summary(summary_json(told), log.trajectory())
    return replace(result, failure_status=128 + stop.signal) if stop.signal else result


def _tick_to_the_end(
    spec: RunSpec,
    loop: ClosedLoop,
    log: TrajectoryLog,
    pacer: Pacer,
    writer: SimulatedRecording | None,
    observer: RunObserver,
    stop: StopRequest,
) -> None:
    factor = spec.plant.real_time_factor
    ticks = round(spec.plant.duration * SECOND_NS) // TICK_NS
    while log.ticks < ticks and not stop.signal and not loop.plant.stopped:
        if delay_s := pacer.delay_s(factor, time.monotonic()):
            time.sleep(delay_s)
        pacer.ticked(factor, time.monotonic())
        tick = loop.tick()
        log.add(tick.truth, *tick.outputs.duty)
        if writer:
            writer.add(tick, loop.program)
        observer.update(log.ticks * TICK_NS / SECOND_NS)


def _begin_recording(
    spec: RunSpec, recording: Path | None, loop: ClosedLoop
) -> SimulatedRecording | None:
    if recording is None:
        return None
    writer = SimulatedRecording(recording, attachments_of(spec), spec.plant.ball_radius)
    writer.begin(FIRST_TICK_NS, loop.world, loop.pushes)
    return writer


def _end_recording(writer: SimulatedRecording, loop: ClosedLoop, summary: RunSummary) -> None:
    last_ns = loop.plant.time_ns - TICK_NS
    if loop.plant.stopped:
        last_ns = loop.plant.time_ns
        writer.add_truth(loop.plant.truth(), wall_hit=loop.plant.wall_hit)
    if summary.outcome is not Outcome.COMPLETED:
        writer.stop_motors(last_ns)
    writer.close(summary)
