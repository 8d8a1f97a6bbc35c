"""Runs a scenario with every node a process of its own, and watches over them."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

from ballbot_ros.cli.experiment import Experiment, Finished
from ballbot_ros.cli.graph import graph_parameters, ros, write_attachments
from ballbot_ros.cli.graph_monitor import GraphMonitor
from ballbot_ros.cli.node_process import NodeProcess, stop_all
from ballbot_ros.cli.progress import Progress
from ballbot_ros.nodes.domain_lock import DomainLock
from ballbot_ros.nodes.middleware import require_discovery, ros_domain
from ballbot_ros.nodes.shared_memory import SETTLED_S, sweep
from ballbot_ros.parameter_file import write_parameter_file
from ballbot_ros.parameters import ALL_NODES, NODES, PLANT, RECORDER
from ballbot_ros.simulation.timing import FIRST_TICK_NS, SECOND_NS
from ballbot_ros.simulation.trajectory import load_trajectory
from ballbot_ros.stop_request import StopRequest

POLL_S = 0.05


def run_in_separate_processes(
    experiment: Experiment,
    scratch: Path,
    progress: Progress,
    is_replaced: Callable[[], bool] = lambda: False,
) -> Finished:
    """Run the graph as processes; all of them have ended when this returns.

    Parameters
    ----------
    experiment : Experiment
    scratch : Path
        Folder for what only the nodes need.
    progress : Progress
    is_replaced : callable
        Whether another run is to take this one's place.
    """
    write_attachments(experiment, scratch)
    parameters = graph_parameters(experiment, scratch)
    trajectory_file = scratch / 'trajectory.npz'
    parameters.set(PLANT, 'trajectory_file', str(trajectory_file))
    parameter_file = scratch / 'parameters.yaml'
    write_parameter_file(parameter_file, parameters, ALL_NODES)
    names = [name for name in NODES if name != RECORDER or experiment.recording]
    processes: dict[str, NodeProcess] = {}
    with StopRequest() as stop, ros():
        try:
            start_nodes(names, parameter_file, progress.notice, processes)
            with GraphMonitor() as monitor:

                def is_told_to_stop() -> bool:
                    return bool(stop.signal) or is_replaced()

                failure = watch(processes, monitor, progress, is_told_to_stop)
        finally:
            stop_all(processes.values(), last=RECORDER)
        if trajectory_file.exists():
            trajectory, summary = load_trajectory(trajectory_file)
        else:
            trajectory, summary = None, {'outcome': 'failed', 'reason': '', 'ticks': 0}
        return Finished(judged(summary, failure, processes, stop, is_replaced()), trajectory)


def start_nodes(
    names: Iterable[str],
    parameter_file: Path,
    notice: Callable[[str], None],
    processes: dict[str, NodeProcess],
) -> None:
    """Start nodes as processes, which are added to `processes` one by one.

    Raises
    ------
    BallbotError
        If another plant has the domain: nodes started into its graph would answer its samples.
        If nodes can't find each other.
    """
    require_discovery()
    lock = DomainLock(ros_domain())
    try:
        for name in names:
            handed_on = lock if name == PLANT else None
            processes[name] = NodeProcess(name, parameter_file, notice, handed_on)
    finally:
        lock.release()


def watch(
    processes: dict[str, NodeProcess],
    monitor: GraphMonitor,
    progress: Progress,
    is_told_to_stop: Callable[[], bool],
) -> str:
    """Wait until the plant has ended; return what went wrong where it can't tell itself."""
    reported: set[str] = set()
    plant = processes[PLANT]
    swept_at = time.monotonic()
    while not is_told_to_stop():
        monitor.poll()
        if monitor.now_ns <= FIRST_TICK_NS and time.monotonic() - swept_at > SETTLED_S:
            # A node may wait for a port that somebody else has left half made since the start.
            sweep()
            swept_at = time.monotonic()
        if monitor.now_ns:
            progress.update((monitor.now_ns - FIRST_TICK_NS) / SECOND_NS)
        for name, process in processes.items():
            if process.running or name in reported:
                continue
            reported.add(name)
            if name == PLANT and not process.died:
                return ''
            progress.notice(f'{name} {process.how_it_ended}')
            # A node that refuses its parameters never comes. In mid-run another may be restarted by
            # hand, and the plant tells when it has waited long enough.
            is_too_early = name in NODES and monitor.now_ns <= FIRST_TICK_NS
            if name == PLANT or process.exit_status == 2 or is_too_early:
                process.hand_on_the_rest()
                return process.failure
        if monitor.plant_hangs(plant.pid):
            # The middleware may never come back to it from a node that was killed.
            died = [p.failure for p in processes.values() if p.died]
            end = ', '.join([f'{PLANT} does not answer', *died])
            progress.notice(end)
            plant.kill()
            return end
        time.sleep(POLL_S)
    return ''


def judged(
    summary: dict[str, Any],
    failure: str,
    processes: Mapping[str, NodeProcess],
    stop: StopRequest,
    is_replaced: bool,
) -> dict[str, Any]:
    """Return the plant's summary with what it can't know.

    A run that the plant has completed is completed, whatever becomes of the processes then.
    """
    verdict = dict(summary)
    verdict['exit_status'] = 1
    failed = {p.name: p.failure for p in processes.values() if p.exit_status in (1, 2)}
    if stop.signal:
        verdict.update(outcome='stopped', exit_status=128 + stop.signal)
    elif is_replaced and verdict['outcome'] != 'completed':
        verdict.update(outcome='stopped', exit_status=0)
    elif failure and verdict['outcome'] != 'completed':
        verdict.update(outcome='failed', reason=failure)
    elif verdict['outcome'] == 'stopped':
        verdict.update(outcome='failed', reason=f'{PLANT} was told to stop')
    elif verdict['outcome'] == 'completed' and RECORDER in failed:
        verdict.update(outcome='failed', reason=failed[RECORDER])
    if verdict['outcome'] == 'failed':
        # A plant that could not leave its account says why.
        causes = [*failed.values(), processes[PLANT].failure]
        verdict['reason'] = verdict['reason'] or causes[0]
        if any(p.exit_status == 2 for p in processes.values()):
            verdict['exit_status'] = 2
    return verdict
