"""The arrangements that the benchmark compares; each run has its own ROS domain."""

from __future__ import annotations

import atexit
import itertools
import json
import os
import resource
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

from ballbot_ros.engine.trajectory import load_trajectory
from ballbot_ros.errors import BallbotError
from ballbot_ros.parameters import NODES, PLANT
from ballbot_ros.parameters.files import write_parameter_file
from ballbot_ros.parameters.timing import SECOND_NS, TICK_NS
from ballbot_ros.run.graph import graph_parameters
from ballbot_ros.run.spec import RunOptions, RunSpec
from benchmark.relay import ROLES as RELAY_ROLES

SCENARIO = 'stationary'
SHORT_S = 0.1
_NEVER_STORED = 'PYTHONDONTWRITEBYTECODE'
_USED = ('ru_utime', 'ru_stime', 'ru_nvcsw', 'ru_nivcsw')

# Not the default domain; the process id makes those of simultaneous benchmarks differ.
_DOMAINS = itertools.cycle([1 + (os.getpid() + number) % 100 for number in range(100)])

_START_S = 30.0
_SLOWEST_FACTOR = 0.2
"""A run may take `_START_S` to start, and then its duration divided by `_SLOWEST_FACTOR`."""
_STOP_S = 5.0


class RunError(BallbotError):
    """A run did not reach its end."""


class Run(NamedTuple):
    """Measurements of a run.

    Attributes
    ----------
    real_time_factor : float
    round_trip_ms : dict or None
        Time of a tick, from the plant's messages to the duty: ``p50``, ``p99``, ``max``; None
        without messages.
    duty_sha256 : str or None
        None for a relay, which has no duties.
    cpu_ms, switches : float
        Processor time [ms] and context switches of a tick, of all threads of all processes.
    start_s : float
        Wall time of the start and the end of all processes [s].
    """

    real_time_factor: float
    round_trip_ms: Mapping[str, float] | None
    duty_sha256: str | None
    cpu_ms: float = 0.0
    switches: float = 0.0
    start_s: float = 0.0

    @classmethod
    def of(cls, result: Mapping[str, Any]) -> Run:
        """Return the measurements in a result."""
        return cls(
            float(result['real_time_factor']),
            result.get('round_trip_ms'),
            result.get('duty_sha256'),
        )


def measured(run: Callable[[float], Run], duration: float) -> Run:
    """Carry out a run, and one of a few ticks, whose costs are those of the start and the end."""
    costs = []
    for length in (SHORT_S, duration + SHORT_S):
        before, begun_s = resource.getrusage(resource.RUSAGE_CHILDREN), time.monotonic()
        result = run(length)
        after, wall_s = resource.getrusage(resource.RUSAGE_CHILDREN), time.monotonic() - begun_s
        used = [getattr(after, name) - getattr(before, name) for name in _USED]
        costs.append((sum(used[:2]), sum(used[2:]), wall_s))
    (short_cpu_s, short_switches, start_s), (cpu_s, switches, _) = costs
    ticks = round(duration * SECOND_NS) // TICK_NS
    return result._replace(
        cpu_ms=1e3 * (cpu_s - short_cpu_s) / ticks,
        switches=(switches - short_switches) / ticks,
        start_s=start_s,
    )


def run_ballbot(duration: float, *, processes: str, record: bool) -> Run:
    """Run the scenario with ``ballbot run``."""
    with _scratch_folder() as folder:
        command = [
            sys.executable, '-m', 'ballbot_ros.cli.main', 'run', SCENARIO, '--json',
            '--processes', processes, '--set', f'{PLANT}.duration={duration}',
        ]  # fmt: skip
        command += ['--output', folder] if record else ['--no-record']
        try:
            ended = subprocess.run(
                command,
                check=False,
                env=_environment(),
                capture_output=True,
                text=True,
                timeout=_time_limit_s(duration),
            )
        except subprocess.TimeoutExpired as error:
            raise RunError(
                f'ballbot run --processes {processes}: did not end within {error.timeout:.0f} s'
            ) from None
    result = json.loads(ended.stdout) if ended.stdout else {'outcome': 'failed', 'reason': ''}
    # Accept a run that misses the scenario's expectations, as a short one may.
    if result['outcome'] in ('failed', 'stopped'):
        reason = result['reason'] or _last_line(ended.stderr)
        raise RunError(f'ballbot run --processes {processes}: {reason}')
    return Run.of(result)


def run_relay(duration: float) -> Run:
    """Run the roles as processes with Unix sockets."""
    ticks = str(round(duration * SECOND_NS) // TICK_NS)
    with _scratch_folder() as folder:
        commands = {
            role: ['benchmark.relay', role, folder, '--ticks', ticks] for role in RELAY_ROLES
        }
        return Run.of(json.loads(_run_graph(commands, duration)))


def run_encoded_loop(duration: float) -> Run:
    """Run the closed loop with all messages encoded."""
    commands = {PLANT: ['benchmark.encoded_loop', SCENARIO, str(duration)]}
    return Run.of(json.loads(_run_graph(commands, duration)))


def run_nodes(duration: float, *, single_threaded: Sequence[str]) -> Run:
    """Run the scenario on nodes, those in `single_threaded` on a SingleThreadedExecutor."""
    with _scratch_folder() as folder:
        parameter_file = Path(folder, 'parameters.yaml')
        trajectory_file = Path(folder, 'trajectory.npz')
        options = RunOptions(assignments=[f'{PLANT}.duration={duration}'])
        spec = RunSpec.of_scenario(SCENARIO, options)
        parameters = graph_parameters(spec, Path(folder, 'run.mcap'), Path(folder))
        parameters.set(PLANT, 'trajectory_file', str(trajectory_file))
        write_parameter_file(parameter_file, parameters)
        commands = {}
        for name in NODES:
            node = ['ballbot_ros.nodes', name]
            if name in single_threaded:
                node = ['benchmark.single_threaded', name]
            commands[name] = [*node, '--ros-args', '--params-file', str(parameter_file)]
        _run_graph(commands, duration)
        _, summary = load_trajectory(trajectory_file)
    return Run.of(summary)


def _run_graph(commands: Mapping[str, Sequence[str]], duration: float) -> str:
    """Run Python modules as processes until the plant's ends; return its output."""
    environment = _environment()
    processes = {
        name: subprocess.Popen(
            [sys.executable, '-m', *command],
            env=environment,
            stdout=subprocess.PIPE if name == PLANT else subprocess.DEVNULL,
            stderr=subprocess.PIPE if name == PLANT else subprocess.DEVNULL,
            text=True,
        )
        for name, command in commands.items()
    }
    plant = processes[PLANT]
    try:
        output, messages = plant.communicate(timeout=_time_limit_s(duration))
    except subprocess.TimeoutExpired:
        gone = [name for name, process in processes.items() if process.poll() is not None]
        raise RunError(f'the graph hangs; ended: {", ".join(gone) or "none"}') from None
    finally:
        _stop(list(processes.values()))
    if plant.returncode:
        raise RunError(f'{PLANT} ended with status {plant.returncode}: {_last_line(messages)}')
    return output


def _stop(processes: Sequence[subprocess.Popen[str]]) -> None:
    for process in processes:
        if process.poll() is None:
            process.send_signal(signal.SIGINT)
    deadline = time.monotonic() + _STOP_S
    for process in processes:
        try:
            process.wait(max(0.0, deadline - time.monotonic()))
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


def _environment() -> dict[str, str]:
    # Where Python may not store compiled modules, every start would compile all of them.
    stored = {name: value for name, value in os.environ.items() if name != _NEVER_STORED}
    return {
        **stored,
        'PYTHONPATH': os.pathsep.join(filter(None, sys.path)),
        'PYTHONPYCACHEPREFIX': _compiled_modules(),
        'ROS_DOMAIN_ID': str(next(_DOMAINS)),
        'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST',
        'OPENBLAS_NUM_THREADS': '1',
    }


@cache
def _compiled_modules() -> str:
    folder = tempfile.TemporaryDirectory(prefix='ballbot_bench_')
    atexit.register(folder.cleanup)
    return folder.name


def _last_line(text: str) -> str:
    return text.strip().rpartition('\n')[2]


def _scratch_folder() -> tempfile.TemporaryDirectory[str]:
    return tempfile.TemporaryDirectory(prefix='ballbot_bench_')


def _time_limit_s(duration: float) -> float:
    return _START_S + duration / _SLOWEST_FACTOR
