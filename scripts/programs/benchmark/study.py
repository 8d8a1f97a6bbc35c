"""How fast studies are, how much memory and disk they need.

Runs of a study count with all that belongs to them: samples, hash, metrics and the written file.
Each is compared with the ordinary loop of the same scenario, alternately.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from itertools import count
from pathlib import Path

import yaml
from distributed import Client
from rich.console import Console

from ballbot_ros.engine.closed_loop import ClosedLoop
from ballbot_ros.engine.scenario.reader import load_scenario
from ballbot_ros.engine.trajectory import TrajectoryLog
from ballbot_ros.lab.studies.cluster import workers_of
from ballbot_ros.lab.studies.execution import LocalWorkers, StudyObserver, WorkersOfJob, run_study
from ballbot_ros.lab.studies.job import job_of
from ballbot_ros.lab.studies.reader import read_study
from ballbot_ros.parameters import PlantParameters
from ballbot_ros.parameters.timing import TICK_S
from benchmark.figures import BYTES, MEGABYTES, RATIO, SECONDS, Figure

RATIOS = {
    'study_ideal': ('ideal devices, linear plant', 'stationary', 40_000, 250.0, 600.0),
    'study_hardware': ('hardware, nonlinear plant', 'hardware_standing', 2_000, 80.0, 250.0),
    'study_map': ('map, sonar and walls', 'autonomous', 10_000, 40.0, 150.0),
}  # fmt: skip
"""Description, scenario, number of runs, bar and aim of each ratio to the ordinary loop."""

ORDINARY_S = 3.0
"""Wall time for which the ordinary loop is measured [s]."""

CLUSTER_RUNS = 100_000

FEW, MANY = 1_000, 1_000_000
SHORT_S = 2.0
"""Duration of the runs whose number grows [s]: the robot is held for the first one."""

_METRICS = ('peak_pitch_deg', 'settling_time_s', 'position_rms_m', 'duty_rms_percent')


def measure_studies(repeat: int, progress: Console) -> list[Figure]:
    """Return the figures of studies."""
    with tempfile.TemporaryDirectory(prefix='ballbot_bench_') as scratch:
        folders = (Path(scratch) / str(number) for number in count())
        return [
            *(_ratio(name, repeat, folders, progress) for name in RATIOS),
            _cores(repeat, folders, progress),
            _growth(repeat, folders, progress),
            _cluster(repeat, folders, progress),
            *_command(repeat, folders, progress),
        ]


def _ratio(name: str, repeat: int, folders: Iterator[Path], progress: Console) -> Figure:
    label, scenario, runs, bar, aim = RATIOS[name]
    _timed(scenario, 16, folders)  # compile, or load what is compiled
    ratios = []
    for number in range(1, repeat + 1):
        ordinary = _ordinary_speed(scenario)
        speed = runs * _duration(scenario) / _timed(scenario, runs, folders)
        progress.print(
            f'{number}/{repeat} {label}: {speed:,.0f} robot-seconds/s, ordinary {ordinary:.0f}'
        )
        ratios.append(speed / ordinary)
    return Figure(name, f'study / ordinary loop, {label}', RATIO, ratios, bar, aim)


def _cores(repeat: int, folders: Iterator[Path], progress: Console) -> Figure:
    ratios = []
    for number in range(1, repeat + 1):
        one, two = (_timed('stationary', 20_000, folders, cores=cores) for cores in (1, 2))
        progress.print(f'{number}/{repeat} one core {one:.2f} s, two {two:.2f} s')
        ratios.append(one / two)
    return Figure('study_cores', 'two cores / one', RATIO, ratios, 1.8, 1.95)


def _cluster(repeat: int, folders: Iterator[Path], progress: Console) -> Figure:
    ratios = []
    with _dask(2) as address:
        # Both workers load the compiled code.
        _timed('stationary', 1_000, folders, workers=workers_of(address))
        for number in range(1, repeat + 1):
            # Local processes have one core each, as the workers have.
            here = _timed('stationary', CLUSTER_RUNS, folders, cores=2)
            there = _timed('stationary', CLUSTER_RUNS, folders, workers=workers_of(address))
            progress.print(f'{number}/{repeat} two cores {here:.2f} s, two workers {there:.2f} s')
            ratios.append(here / there)
    label = 'speed of two Dask workers / two cores of one process'
    return Figure('study_cluster', label, RATIO, ratios, 0.9, 0.97)


@contextmanager
def _dask(workers: int) -> Iterator[str]:
    """Run a scheduler with workers of one thread each on the loopback; yield its address."""
    loopback = ['--host', '127.0.0.1', '--dashboard-address', '127.0.0.1:0']
    command = [sys.executable, '-m', 'dask']
    with tempfile.TemporaryDirectory(prefix='ballbot_bench_') as scratch, ExitStack() as stack:

        def start(*words: str) -> None:
            process = subprocess.Popen(
                [*command, *words, *loopback], cwd=scratch, stderr=subprocess.DEVNULL
            )
            stack.callback(process.wait)
            stack.callback(process.kill)

        file = Path(scratch) / 'scheduler.json'
        start('scheduler', '--port', '0', '--scheduler-file', str(file))
        while not (file.exists() and file.read_text(encoding='utf-8').endswith('}')):
            time.sleep(0.05)
        address = str(json.loads(file.read_text(encoding='utf-8'))['address'])
        for _ in range(workers):
            start('worker', address, '--nthreads', '1', '--no-nanny', '--local-directory', scratch)
        with Client(address, set_as_default=False) as client:
            client.wait_for_workers(workers)
        yield address


def _growth(repeat: int, folders: Iterator[Path], progress: Console) -> Figure:
    ratios = []
    for number in range(1, repeat + 1):
        # Few runs are so quick that several of them are timed.
        few = sum(_timed('stationary', FEW, folders, SHORT_S) for _ in range(20)) / 20 / FEW
        many = _timed('stationary', MANY, folders, SHORT_S) / MANY
        progress.print(
            f'{number}/{repeat} {few * 1e6:.1f} µs a run of {FEW}, {many * 1e6:.1f} of {MANY}'
        )
        ratios.append(many / few)
    label = f'time a run, {MANY:.0e} runs / {FEW:.0e}'
    return Figure('study_growth', label, RATIO, ratios, 1.1, at_most=True)


def _command(repeat: int, folders: Iterator[Path], progress: Console) -> Iterator[Figure]:
    """Yield the figures of the command as a process of its own."""
    first = []
    for _ in range(repeat):
        begun = time.perf_counter()
        _run_command(_write_study(next(folders), 'stationary', 16))
        first.append(time.perf_counter() - begun)
        progress.print(f'first result after {first[-1]:.2f} s')
    yield Figure(
        'study_first_result', 'first result after the start', SECONDS, first, 3.0, 1.0, at_most=True
    )
    folder = next(folders)
    memory = _run_command(_write_study(folder, 'stationary', MANY, SHORT_S))
    progress.print(f'{MANY} runs need {memory:.0f} MB')
    yield Figure(
        'study_memory', f'peak memory, {MANY:.0e} runs', MEGABYTES, [memory], 1000.0, 300.0,
        at_most=True,
    )  # fmt: skip
    size = sum(each.stat().st_size for each in (folder / 'results/parts').iterdir()) / MANY
    stored = 1 + len(_METRICS)
    yield Figure(
        'study_row', f'size of a row, {stored} numbers', BYTES, [size],
        60.0 + 8.0 * stored, 40.0 + 6.0 * stored, at_most=True,
    )  # fmt: skip


def _ordinary_speed(name: str) -> float:
    """Return the sim time per wall time of the ordinary loop, without ROS and recording."""
    scenario = load_scenario(name)
    loop, log = ClosedLoop(scenario.parameters, scenario), TrajectoryLog()
    begun = time.perf_counter()
    while time.perf_counter() - begun < ORDINARY_S:
        for _ in range(100):
            tick = loop.tick()
            log.add(tick.truth, *tick.outputs.duty)
    return log.ticks * TICK_S / (time.perf_counter() - begun)


def _duration(name: str) -> float:
    return load_scenario(name).parameters.of(PlantParameters).duration


def _write_study(folder: Path, scenario: str, runs: int, duration: float | None = None) -> Path:
    folder.mkdir()
    content = {
        'purpose': 'measures the speed of studies',
        'scenario': scenario,
        'runs': runs,
        'vary': {'plant_sim.body_mass': {'uniform': [0.65, 0.70]}},
        'metrics': list(_METRICS),
        'expectations': {'peak_pitch_deg': {'max': 10.0}},
    }
    if duration is not None:
        content['parameters'] = {'plant_sim': {'duration': duration}}
    path = folder / 'study.yaml'
    path.write_text(yaml.safe_dump(content), encoding='utf-8')
    return path


def _timed(
    scenario: str,
    runs: int,
    folders: Iterator[Path],
    duration: float | None = None,
    cores: int | None = None,
    workers: WorkersOfJob = LocalWorkers,
) -> float:
    """Return the time [s] of a study in this process, on all cores or so many, or by workers."""
    path = _write_study(next(folders), scenario, runs, duration)
    study = read_study(str(path))
    job = job_of(study, path.parent / 'results')
    with _affinity(cores):
        begun = time.perf_counter()
        run_study(job, StudyObserver(), workers)
        return time.perf_counter() - begun


@contextmanager
def _affinity(cores: int | None) -> Iterator[None]:
    """Let this process use only so many cores."""
    allowed = os.sched_getaffinity(0)
    os.sched_setaffinity(0, sorted(allowed)[:cores])
    try:
        yield
    finally:
        os.sched_setaffinity(0, allowed)


def _run_command(study: Path) -> float:
    """Run a study by its command; return its peak memory [MB]."""
    command = [
        sys.executable, '-m', 'ballbot_ros.cli.main', 'study', str(study),
        '--output', str(study.parent / 'results'), '--json',
    ]  # fmt: skip
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL)
    _, status, usage = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        raise RuntimeError(f'ballbot study ended with status {process.returncode}')
    return usage.ru_maxrss * 1024 / 1e6
