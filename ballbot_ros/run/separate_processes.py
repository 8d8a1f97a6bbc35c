"""Running a scenario with one process per node, and monitoring the processes."""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Mapping
from contextlib import ExitStack
from dataclasses import replace
from functools import partial
from pathlib import Path

from ballbot_ros.engine.trajectory import load_trajectory
from ballbot_ros.errors import BallbotError
from ballbot_ros.lockstep.liveness import SilenceTimer
from ballbot_ros.lockstep.run_actions import Outcome
from ballbot_ros.nodes.middleware import (
    LOCK_FD_ENV,
    DomainLock,
    prepare_middleware,
    require_discovery,
    require_places,
    ros_domain,
    stay_local,
)
from ballbot_ros.nodes.processes import (
    HEARTBEAT_FD_ENV,
    HeartbeatPipe,
    started_nodes_variable,
    threads_by_process,
)
from ballbot_ros.parameters import ALL_NODES, NODES, PLANT, RECORDER, ParameterSet
from ballbot_ros.parameters.files import write_parameter_file
from ballbot_ros.parameters.timing import FIRST_TICK_NS, SECOND_NS
from ballbot_ros.process import StopRequest
from ballbot_ros.recording.reader import is_finished
from ballbot_ros.run.graph import call_for_external, graph_parameters
from ballbot_ros.run.node_process import ForkClient, NodeProcess, stop_all
from ballbot_ros.run.observer import RunObserver
from ballbot_ros.run.requirements import OR_NONE, ros_not_found
from ballbot_ros.run.result import RunResult
from ballbot_ros.run.spec import RunSpec

PLANT_SILENCE_S = 2.3
"""Silence after which the plant counts as hung [s]. Time in which the machine is too busy to run it
does not count."""

PLANT_BUSY_S = 30.0
"""The same before the plant's first heartbeat, while its process starts, and after the end of its
run, while it saves the result."""


class PlantMonitor:
    """Reads the plant's signs of life, and distinguishes one that hangs from one that is starved.

    `now_ns` is the sim time [ns], 0 before the first tick.
    """

    def __init__(self) -> None:
        self.pipe = HeartbeatPipe()
        self.now_ns = 0
        self._heard_s, self._limit_s = time.monotonic(), PLANT_BUSY_S
        self._timer = SilenceTimer()

    def __enter__(self) -> PlantMonitor:
        return self

    def __exit__(self, *error: object) -> None:
        self.pipe.close()

    def poll(self) -> None:
        """Process what has arrived since the last poll."""
        if beat := self.pipe.newest():
            self.now_ns, self._heard_s = beat.now_ns, time.monotonic()
            self._limit_s = PLANT_BUSY_S if beat.has_ended else PLANT_SILENCE_S

    def plant_hangs(self, process: int) -> bool:
        """Return whether the plant, which runs as `process`, has been silent for too long."""
        threads = threads_by_process([process])
        self._timer.update(self._heard_s, time.monotonic(), threads)
        return self._timer.silence_s(process) > self._limit_s


POLL_S = 0.05


def run_in_separate_processes(
    client: ForkClient,
    spec: RunSpec,
    recording: Path | None,
    scratch: Path,
    observer: RunObserver,
    is_replaced: Callable[[], bool],
    *,
    starts_paused: bool = False,
) -> RunResult:
    """Run the graph as processes, all of which have ended on return.

    The options are those of :func:`~ballbot_ros.run.execution.execute`, the files those of
    :func:`~ballbot_ros.run.graph.graph_parameters`.
    """
    parameters = graph_parameters(spec, recording, scratch)
    trajectory_file = scratch / 'trajectory.npz'
    parameters.set(PLANT, 'trajectory_file', str(trajectory_file))
    if starts_paused:
        # Not in the recording's parameters: a replay waits for nobody.
        parameters.set(PLANT, 'start_paused', True)
    stay_local()
    with StopRequest() as stop:
        prepare_middleware()

        def should_stop() -> bool:
            return bool(stop.signal) or is_replaced()

        call_for_external(spec, observer)
        processes, failure = run_nodes(
            client, spec.nodes, parameters, scratch, observer, should_stop
        )
        plant_result = RunResult(Outcome.FAILED)
        if trajectory_file.exists():
            trajectory, summary = load_trajectory(trajectory_file)
            plant_result = RunResult.from_summary(summary, trajectory)
        return merge_process_failures(
            processes,
            plant_result,
            failure,
            stop,
            is_replaced=is_replaced(),
            is_recorded=recording is None or is_finished(recording),
        )


def run_nodes(
    client: ForkClient,
    names: Collection[str],
    parameters: ParameterSet,
    scratch: Path,
    observer: RunObserver,
    should_stop: Callable[[], bool],
) -> tuple[Mapping[str, NodeProcess], str]:
    """Run nodes as processes; return them after their end, and the failure that was watched.

    It raises BallbotError if another plant, whose samples the nodes would answer, owns the ROS
    domain, or if not all nodes can discover each other.
    """
    parameter_file = scratch / 'parameters.yaml'
    write_parameter_file(parameter_file, parameters, ALL_NODES)
    require_discovery()
    require_places(len({PLANT, *names}))
    processes: dict[str, NodeProcess] = {}
    client.await_ready(should_stop)
    if client.ros_error:
        raise ros_not_found(client.ros_error, OR_NONE)
    if should_stop():
        return {}, ''
    with PlantMonitor() as monitor, ExitStack() as stack:
        stack.callback(lambda: stop_all(processes.values(), last=RECORDER))
        start = partial(
            NodeProcess,
            client,
            parameter_file=parameter_file,
            notice=observer.notice,
            should_stop=should_stop,
        )
        try:
            with DomainLock(ros_domain()) as lock:
                for name in names:
                    if name != PLANT:
                        processes[name] = start(name)
                # Last, because it must know the others: it waits until all of them have joined.
                participants = {name: each.pid for name, each in processes.items() if name in NODES}
                plant = start(
                    PLANT,
                    inherited={LOCK_FD_ENV: lock.file, HEARTBEAT_FD_ENV: monitor.pipe.theirs},
                    variables=started_nodes_variable(participants),
                )
                processes = {PLANT: plant, **processes}
        except BallbotError:
            if should_stop():
                return processes, ''
            raise
        return processes, watch(client, processes, monitor, observer, should_stop)


def watch(
    client: ForkClient,
    processes: dict[str, NodeProcess],
    monitor: PlantMonitor,
    observer: RunObserver,
    should_stop: Callable[[], bool],
) -> str:
    """Wait until the plant has ended, or the run should stop.

    Return a failure that the plant can't report itself; '' if there is none.
    """
    reported: set[str] = set()
    plant = processes[PLANT]
    while not should_stop():
        monitor.poll()
        if monitor.now_ns:
            observer.update((monitor.now_ns - FIRST_TICK_NS) / SECOND_NS)
        if failure := client.failure():
            return failure
        for name, process in processes.items():
            if process.running or name in reported:
                continue
            reported.add(name)
            if name == PLANT and not process.was_killed:
                return ''
            observer.notice(f'{name} {process.exit_description}')
            # Fail at once if a node refuses its parameters or ends too early: it never joins. In
            # mid-run, keep waiting: somebody may restart the node by hand, and the plant reports
            # when it has waited long enough.
            is_too_early = name in NODES and monitor.now_ns <= FIRST_TICK_NS
            if name == PLANT or process.exit_status == 2 or is_too_early:
                process.forward_remaining_output()
                return process.failure
        if monitor.plant_hangs(plant.pid):
            end = f'{PLANT} does not answer'
            observer.notice(end)
            plant.kill()
            return end
        time.sleep(POLL_S)
    return ''


def merge_process_failures(
    processes: Mapping[str, NodeProcess],
    plant_result: RunResult,
    failure: str,
    stop: StopRequest,
    *,
    is_replaced: bool,
    is_recorded: bool = True,
) -> RunResult:
    """Return the result of a run, including failures that the plant can't know.

    A run that the plant has completed stays completed, whatever happens to the processes
    afterwards, if its recording is finished. `failure` is what :func:`watch` has returned.
    """
    failed = {p.name: p.failure for p in processes.values() if p.exit_status in (1, 2)}
    if not is_recorded and RECORDER in processes:
        failed[RECORDER] = processes[RECORDER].failure
    is_complete = plant_result.is_complete
    if stop.signal:
        status = 128 + stop.signal
        return replace(plant_result, outcome=Outcome.STOPPED, failure_status=status)
    if is_replaced and not is_complete:
        return replace(plant_result, outcome=Outcome.STOPPED, failure_status=0)
    result = plant_result
    if failure and not is_complete:
        result = result.failed(failure)
    elif result.outcome is Outcome.STOPPED:
        result = result.failed(f'{PLANT} was stopped')
    elif is_complete and RECORDER in failed:
        result = result.failed(failed[RECORDER])
    if result.outcome is Outcome.FAILED:
        if not result.failure:
            # Take the reason from the log: a plant that could not save its summary has logged it.
            result = result.failed([*failed.values(), processes[PLANT].failure][0])
        if any(p.exit_status == 2 for p in processes.values()):
            result = replace(result, failure_status=2)
    return result
