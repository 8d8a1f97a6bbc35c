"""Running a scenario in this process, without ROS."""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from ballbot_ros.analysis.extraction import MessageCollector
from ballbot_ros.analysis.recorded_scenario import RecordedAttachments, read_attachments
from ballbot_ros.analysis.run_data import RunData, run_data
from ballbot_ros.controllers.codegen.implementation import implementation_for
from ballbot_ros.controllers.document.program import ControlProgram
from ballbot_ros.engine.closed_loop import ClosedLoop
from ballbot_ros.engine.compiled_loop import CompiledLoop, compile_for_the_next_time, pays
from ballbot_ros.engine.law_runs import FAULTS
from ballbot_ros.engine.pacer import Pacer
from ballbot_ros.engine.trajectory import Engine, TrajectoryLog
from ballbot_ros.engine.tuned_program import TunedProgram
from ballbot_ros.errors import ControllerError, RecordingError, one_line
from ballbot_ros.lockstep.run_actions import Outcome, RunSummary
from ballbot_ros.parameters import CONTROLLER, ControllerParameters
from ballbot_ros.parameters.changes import PendingChanges
from ballbot_ros.parameters.timing import FIRST_TICK_NS, SECOND_NS, TICK_NS
from ballbot_ros.process import StopRequest
from ballbot_ros.recording.messages.run_messages import RUN_NAME
from ballbot_ros.recording.messages.run_reports import summary_json
from ballbot_ros.recording.reader import AttachedFile
from ballbot_ros.recording.rosbag2 import media_type
from ballbot_ros.run.graph import attachments_of, public_parameters, versions
from ballbot_ros.run.observer import RunObserver
from ballbot_ros.run.result import RunResult
from ballbot_ros.run.simulated_recording import SimulatedRecording
from ballbot_ros.run.spec import RunSpec
from ballbot_ros.run.tick_timer import TickTimer

_TICKS_AT_ONCE, _RECORDED_TICKS_AT_ONCE = 25_000, 2_500
"""Compiled code makes them in a tenth of a second, after which a signal takes effect."""


def run_offline(
    spec: RunSpec, recording: Path | None, observer: RunObserver, *, collects_data: bool = False
) -> RunResult:
    """Run the closed loop; the recording is the same as from the graph.

    With `collects_data`, the result of a compiled run has the data of its recording.
    """
    with StopRequest() as stop:
        run = _OfflineRun(spec, recording, stop, collects_data=collects_data)
        try:
            failure = ''
            try:
                with TickTimer(spec.controller, spec.plant, stop):
                    run.run_to_end(observer)
            except ControllerError as error:
                # After a request to stop, a tick that does not return was interrupted by it.
                failure = '' if stop.signal else f'{CONTROLLER}: {error}'
            failure = failure or run.wall_hit
            for notice in filter(None, (failure, run.slow_ticks)):
                observer.notice(notice)
            summary = run.summary(failure)
            data = run.end_recording(summary)
        except RecordingError as error:
            data = None
            summary = run.summary(str(error))
            observer.notice(str(error))
    if run.engine is Engine.INTERPRETED:
        compile_for_the_next_time()
    result = RunResult.from_summary(summary_json(summary), run.log.trajectory())
    result = replace(result, engine=run.engine, data=data)
    return replace(result, failure_status=128 + stop.signal) if stop.signal else result


class _OfflineRun:
    """A closed loop with log, recording and pacing."""

    def __init__(
        self, spec: RunSpec, recording: Path | None, stop: StopRequest, *, collects_data: bool
    ) -> None:
        self._spec, self._recording = spec, recording
        self._implementation = implementation_for(
            spec.parameters.of(ControllerParameters), spec.controller
        )
        self._begin()
        self._plant_parameters = spec.plant
        self._ticks = round(spec.plant.duration * SECOND_NS) // TICK_NS
        self._compiled: CompiledLoop | None = None
        program, is_paced = self._loop.program, spec.plant.real_time_factor > 0.0
        # Of a law that changes on the way, the interpreter makes all ticks.
        is_plain = self._tuned.changes.next_ns is None or isinstance(program, ControlProgram)
        if not is_paced and is_plain and pays(self._ticks, program):
            self._compiled = CompiledLoop(self._loop, program, spec.parameters, spec.scenario)
        self._stop = stop
        self._pacer = Pacer()
        self._writer: SimulatedRecording | None = None
        collects_data = collects_data and self._compiled is not None
        self._collector = MessageCollector(RUN_NAME, FIRST_TICK_NS) if collects_data else None
        if recording:
            self._attachments = attachments_of(spec)
            collect = self._collector.add if self._collector else None
            self._writer = SimulatedRecording(
                recording, self._attachments, spec.parameters, collect
            )
            self._writer.begin(FIRST_TICK_NS, self._loop.world, self._loop.pushes)
        self._begun = time.monotonic()

    def _begin(self) -> None:
        spec = self._spec
        parameters = spec.parameters.of(ControllerParameters)
        changes = PendingChanges.of(parameters, FIRST_TICK_NS)
        self._tuned = TunedProgram(self._implementation, changes)
        self._loop = ClosedLoop(spec.parameters, spec.scenario, program=self._tuned.program)
        self.log = TrajectoryLog(parameters)

    @property
    def engine(self) -> Engine:
        """What makes the ticks."""
        return Engine.COMPILED if self._compiled else Engine.INTERPRETED

    @property
    def wall_hit(self) -> str:
        """Description of the wall hit that ended the run; '' if there is none."""
        return str(self._loop.plant.newest_hit) if self._loop.plant.stopped else ''

    @property
    def slow_ticks(self) -> str:
        """That the controller is too slow; '' if it is not."""
        problem = self._implementation.times.problem
        return problem and f'{CONTROLLER}: {problem}'

    def run_to_end(self, observer: RunObserver) -> None:
        """Run the ticks, paced, until the end of the run, a wall hit or a signal."""
        while self.log.ticks < self._ticks and not self.wall_hit and not self._stop.signal:
            if self._compiled:
                self._advance(self._compiled)
            else:
                self._tick()
            observer.update(self.log.ticks * TICK_NS / SECOND_NS)

    def _advance(self, loop: CompiledLoop) -> None:
        begun_ns = self._loop.plant.time_ns
        left = self._ticks - self.log.ticks
        if (change_ns := self._tuned.changes.next_ns) is not None:
            left = min(left, -(-(change_ns - begun_ns) // TICK_NS))
        if left <= 0:
            self._compiled = None  # gains that glide to new values are interpreted
            return
        try:
            if self._writer:
                part, ticks = loop.trace(min(_RECORDED_TICKS_AT_ONCE, left))
            else:
                part = loop.advance(min(_TICKS_AT_ONCE, left))
        except FAULTS:  # of a law; the interpreter tells them
            self._compiled = None
            if not self._writer:
                self._begin()  # since the law has not made the ticks so far
            return
        if self._writer:
            self._writer.add_all(ticks, loop.program)
        stamps_ns = begun_ns + TICK_NS * np.arange(len(part.duty))
        self.log.extend(stamps_ns, part)

    def _tick(self) -> None:
        factor = self._plant_parameters.real_time_factor
        if delay_s := self._pacer.delay_s(factor, time.monotonic()):
            time.sleep(delay_s)
        self._pacer.on_tick(factor, time.monotonic())
        now_ns = self._loop.plant.time_ns
        if (values := self._tuned.advance(now_ns)) and self._writer:
            self._writer.controller.retuned(now_ns, values)
        tick = self._loop.tick()
        self.log.add(tick.truth, *tick.outputs.duty, tick.outputs)
        if self._writer:
            self._writer.add(tick, self._loop.program)

    def summary(self, failure: str) -> RunSummary:
        """Return the summary of the run; `failure` is why it failed, '' if it did not."""
        outcome = Outcome.STOPPED if self._stop.signal else Outcome.COMPLETED
        wall_s = time.monotonic() - self._begun
        return RunSummary(
            outcome=Outcome.FAILED if failure else outcome,
            reason=failure,
            ticks=self.log.ticks,
            duty_sha256=self.log.duty_sha256,
            real_time_factor=self.log.ticks * TICK_NS / SECOND_NS / wall_s,
            late_ticks=self._pacer.late_ticks,
            resends=0,
            round_trips_s=(),
            start_ns=FIRST_TICK_NS,
        )

    def end_recording(self, summary: RunSummary) -> RunData | None:
        """Write how the run ended, and finish the file; return the data that were collected."""
        if self._recording is None or self._writer is None:
            return None
        plant = self._loop.plant
        last_ns = plant.time_ns - TICK_NS
        if plant.stopped:
            last_ns = plant.time_ns
            self._writer.plant.truth(plant.truth(), wall_hit=plant.wall_hit)
        if summary.outcome is not Outcome.COMPLETED:
            self._writer.plant.stop_motors(last_ns)
        self._writer.close(summary)
        if self._collector is None or not self.log.ticks:
            return None
        extraction = self._collector.extraction(self._writer.names)
        failure = one_line(summary.reason)
        return run_data(self._recording, extraction, self._attached(), failure=failure)

    def _attached(self) -> RecordedAttachments:
        """Return the content of the attachments; to read them takes 10 ms."""
        files = {
            name: AttachedFile(media_type(name), data) for name, data in self._attachments.items()
        }
        if self._spec.controller:  # with parameters of its own, which are read without its class
            return replace(read_attachments(files), scenario=self._spec.scenario)
        world = self._loop.world
        return RecordedAttachments(
            scenario=self._spec.scenario,
            parameters=public_parameters(self._spec, self._attachments),
            has_parameters=True,
            versions=dict(versions()),
            floor_map=world.map if world else None,
            files=files,
        )
