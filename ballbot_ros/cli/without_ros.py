"""Runs a scenario in this process, without ROS."""

from __future__ import annotations

import time

from ballbot_ros.cli.progress import Progress
from ballbot_ros.cli.run import Experiment, Finished
from ballbot_ros.nodes.simulated_recording import SimulatedRecording
from ballbot_ros.parameters import PLANT
from ballbot_ros.recording.errors import RecordingError
from ballbot_ros.simulation.closed_loop import ClosedLoop
from ballbot_ros.simulation.pacer import Pacer
from ballbot_ros.simulation.timing import FIRST_TICK_NS, SECOND_NS, TICK_NS
from ballbot_ros.simulation.trajectory import TrajectoryLog
from ballbot_ros.stop_request import StopRequest


def run_without_ros(experiment: Experiment, progress: Progress) -> Finished:
    """Run the closed loop, recorded as the graph would be."""
    plant = experiment.parameters.values(PLANT)
    ticks = round(plant['duration'] * SECOND_NS) // TICK_NS
    factor = plant['real_time_factor']
    loop = ClosedLoop(experiment.parameters, experiment.scenario)
    log, pacer = TrajectoryLog(), Pacer()
    recording = _recording(experiment, float(plant['ball_radius']))
    failure = ''
    begun = time.monotonic()
    with StopRequest() as stop:
        try:
            while log.ticks < ticks and not stop.signal:
                pacer.wait(factor)
                tick = loop.tick()
                log.add(tick.truth, *tick.outputs.duty)
                if recording:
                    recording.add(tick, loop.program)
                progress.update(log.ticks * TICK_NS / SECOND_NS)
            wall = time.monotonic() - begun
            if recording:
                outcome = 'stopped' if stop.signal else 'completed'
                recording.close(
                    {
                        'outcome': outcome,
                        'reason': '',
                        'ticks': log.ticks,
                        'duty_sha256': log.duty_sha256,
                    }
                )
        except RecordingError as error:
            wall = time.monotonic() - begun
            failure = str(error)
            progress.notice(failure)
    summary = {
        'outcome': 'failed' if failure else 'stopped' if stop.signal else 'completed',
        'reason': failure,
        'exit_status': 128 + stop.signal if stop.signal else 1,
        'ticks': log.ticks,
        'duty_sha256': log.duty_sha256,
        'real_time_factor': log.ticks * TICK_NS / SECOND_NS / wall,
        'missed_ticks': pacer.late,
        'asked_again': 0,
        'round_trip_ms': None,
    }
    return Finished(summary, log.trajectory())


def _recording(experiment: Experiment, ball_radius: float) -> SimulatedRecording | None:
    if experiment.recording is None:
        return None
    recording = SimulatedRecording(experiment.recording, experiment.attachments, ball_radius)
    recording.begin(FIRST_TICK_NS)
    return recording
