"""Measures how fast the robot runs in each arrangement: ``python -m benchmark.bench``.

Speeds vary with the other load on the machine. Arrangements to compare therefore run alternately,
A B A B …, and are compared pair by pair.
"""

from __future__ import annotations

import json
import os
import platform
import sys
from collections.abc import Callable, Sequence
from functools import partial

import click
from rich.console import Console

from ballbot_ros.cli.command import invoke
from ballbot_ros.parameters import CONTROLLER, NODES
from benchmark.figures import MILLISECONDS, RATIO, REAL_TIME, SECONDS, Figure, as_json, table_of
from benchmark.film import measure_films
from benchmark.long_page import measure_long_pages
from benchmark.runs import (
    SCENARIO,
    SHORT_S,
    Run,
    RunError,
    measured,
    run_ballbot,
    run_encoded_loop,
    run_nodes,
    run_relay,
)

Measurements = dict[str, list[Run]]

SEPARATE = 'separate'
UNRECORDED = 'separate_unrecorded'
RELAY = 'relay'
ONE = 'one'
ONE_UNRECORDED = 'one_unrecorded'
NONE = 'none'
NONE_RECORDED = 'none_recorded'
LOOP = 'encoded_loop'
EVENTS = 'events_executor'
STUDY = 'study'
FILM = 'film'
PAGE = 'page'
CONTROLLER_SINGLE = 'controller_single_threaded'
ALL_SINGLE = 'all_single_threaded'

ARRANGEMENTS: dict[str, tuple[str, Callable[[float], Run]]] = {
    SEPARATE: (
        'separate processes, recording',
        partial(run_ballbot, processes='separate', record=True),
    ),
    UNRECORDED: (
        'separate processes',
        partial(run_ballbot, processes='separate', record=False),
    ),
    RELAY: ('relay over Unix sockets', run_relay),
    ONE: ('one process, recording', partial(run_ballbot, processes='one', record=True)),
    ONE_UNRECORDED: ('one process', partial(run_ballbot, processes='one', record=False)),
    NONE: ('without ROS', partial(run_ballbot, processes='none', record=False)),
    NONE_RECORDED: (
        'without ROS, recording',
        partial(run_ballbot, processes='none', record=True),
    ),
    LOOP: ('closed loop with encoding', run_encoded_loop),
    EVENTS: ('EventsExecutor everywhere', partial(run_nodes, single_threaded=())),
    CONTROLLER_SINGLE: (
        'SingleThreadedExecutor in the controller',
        partial(run_nodes, single_threaded=(CONTROLLER,)),
    ),
    ALL_SINGLE: (
        'SingleThreadedExecutor everywhere',
        partial(run_nodes, single_threaded=NODES),
    ),
}
"""Arrangements: a description, and the function that runs each for a time [s]."""

BARS = {
    SEPARATE: (3.0, 5.0),
    ONE: (8.0, 15.0),
    NONE: (100.0, None),
    NONE_RECORDED: (30.0, None),
}
"""Bar and aim of the real-time factors."""

COSTS = (
    (SEPARATE, NONE_RECORDED, 14.0, 8.0),
    (ONE_UNRECORDED, LOOP, 3.0, 2.0),
    (UNRECORDED, RELAY, 7.0, 4.0),
)
"""Arrangements whose processor times are compared; bar and aim of their ratio."""

WIDTH = 100
"""Width of the table without a terminal."""

BUSY = 0.5
"""Load average at the start above which the figures are doubtful."""

PARTS = {
    'separate': (SEPARATE, NONE_RECORDED),
    'relay': (UNRECORDED, RELAY),
    'one': (ONE, ONE_UNRECORDED, LOOP),
    'none': (NONE, NONE_RECORDED),
    'executors': (EVENTS, CONTROLLER_SINGLE, ALL_SINGLE),
    STUDY: (),
    FILM: (),
    PAGE: (),
}
"""The arrangements needed for each part of the benchmark, in order."""


@click.command(context_settings={'help_option_names': ['-h', '--help'], 'max_content_width': 100})
@click.option('--json', 'print_json', is_flag=True, help='Print a JSON object to stdout.')
@click.option(
    '--repeat',
    type=click.IntRange(1, 100),
    default=3,
    show_default=True,
    help='Runs of each arrangement.',
)
@click.option(
    '--duration',
    type=click.FloatRange(1.0, 600.0),
    default=10.0,
    show_default=True,
    help='Length of a run in sim time [s].',
)
@click.option(
    '--only',
    type=click.Choice(list(PARTS)),
    multiple=True,
    help='Measure this part; can be repeated.  [default: all parts]',
)
def bench(print_json: bool, repeat: int, duration: float, only: tuple[str, ...]) -> None:
    """Measure how fast the robot runs in each arrangement, and compare this with the bars.

    Prints a table, with --json to stderr. The exit status is 1 if a run fails or its duties differ
    from another's, else 0, whether the bars are reached or not.
    """
    load_average = os.getloadavg()[0]
    wanted = [name for part in only or PARTS for name in PARTS[part]]
    arrangements = [name for name in ARRANGEMENTS if name in wanted]
    progress = Console(stderr=True, highlight=False)
    measurements = measure(arrangements, repeat, duration, progress)
    duty_sha256 = common_hash(measurements)
    figures = figures_of(measurements)
    if STUDY in (only or PARTS):
        # The only part that needs the extra cluster.
        from benchmark.study import measure_studies

        figures += measure_studies(repeat, progress)
    if FILM in (only or PARTS):
        figures += measure_films(repeat, progress)
    if PAGE in (only or PARTS):
        figures += measure_long_pages(repeat, progress)

    console = Console(stderr=print_json, highlight=False)
    if not console.is_terminal:
        console.width = WIDTH
    title = f'{SCENARIO}, {duration:g} s, {repeat} runs each; × is the real-time factor'
    console.print(table_of(figures, title))
    if duty_sha256:
        console.print(f'all runs have the same duties: {duty_sha256}', soft_wrap=True)
    if load_average > BUSY:
        console.print(f'[yellow]the machine was busy before: load average {load_average:.1f}[/]')
    if print_json:
        result = {
            'scenario': SCENARIO,
            'duration_s': duration,
            'repeat': repeat,
            'cpus': os.cpu_count(),
            'python': platform.python_version(),
            'load_average_before': load_average,
            'duty_sha256': duty_sha256,
            'figures': as_json(figures),
        }
        print(json.dumps(result, indent=2, allow_nan=False))


def measure(
    arrangements: Sequence[str], repeat: int, duration: float, progress: Console
) -> Measurements:
    """Run the arrangements alternately, `repeat` times each."""
    measurements: Measurements = {name: [] for name in arrangements}
    for name in arrangements:
        ARRANGEMENTS[name][1](SHORT_S)  # compiles the modules that are not compiled yet
    for number in range(1, repeat + 1):
        for name in arrangements:
            label, run = ARRANGEMENTS[name]
            progress.print(f'{number}/{repeat} {label}: ', end='')
            try:
                result = measured(run, duration)
            except RunError:
                progress.print()
                raise
            progress.print(
                f'{result.real_time_factor:.1f} × real time, {result.cpu_ms:.2f} ms per tick'
            )
            measurements[name].append(result)
    return measurements


def common_hash(measurements: Measurements) -> str | None:
    """Return the hash of the duties, which all runs must share.

    Raises
    ------
    RunError
        If two runs differ.
    """
    found = {
        run.duty_sha256: name
        for name, runs in measurements.items()
        for run in runs
        if run.duty_sha256
    }
    if len(found) > 1:
        raise RunError(f'the duties differ: {", ".join(f"{found[h]} {h}" for h in found)}')
    return next(iter(found), None)


def figures_of(measurements: Measurements) -> list[Figure]:
    """Return the figures from the runs."""
    figures = []
    for name, runs in measurements.items():
        bar, aim = BARS.get(name, (None, None))
        speeds = [run.real_time_factor for run in runs]
        figures.append(Figure(name, ARRANGEMENTS[name][0], REAL_TIME, speeds, bar, aim))
        figures += _costs(name, runs)
    for name, other, bar, aim in COSTS:
        if {name, other} <= measurements.keys():
            pairs = zip(measurements[name], measurements[other], strict=True)
            ratios = [one.cpu_ms / two.cpu_ms for one, two in pairs]
            label = f'processor time, {name} / {other}'
            figures.append(
                Figure(f'{name}_to_{other}', label, RATIO, ratios, bar, aim, at_most=True)
            )
    if EVENTS in measurements:
        for name, where in ((CONTROLLER_SINGLE, 'in the controller'), (ALL_SINGLE, 'everywhere')):
            label = f'gain of EventsExecutor {where}'
            ratios = _ratios(measurements, EVENTS, name)
            figures.append(Figure(f'{EVENTS}_to_{name}', label, RATIO, ratios))
    for name, where in ((SEPARATE, 'separate processes'), (ONE, 'one process')):
        trips = [run.round_trip_ms for run in measurements.get(name, []) if run.round_trip_ms]
        for key in ('p50', 'p99', 'max') if trips else ():
            label = f'round trip of a tick, {where}, {key}'
            values = [trip[key] for trip in trips]
            figures.append(Figure(f'round_trip_{name}_{key}', label, MILLISECONDS, values))
    return figures


def _costs(name: str, runs: Sequence[Run]) -> list[Figure]:
    """Return what a tick costs in an arrangement, and the start."""
    costs = [run.cpu_ms for run in runs]
    found = [Figure(f'{name}_cpu_ms', f'processor time of a tick, {name}', MILLISECONDS, costs)]
    if name == SEPARATE:
        switches = [run.switches for run in runs]
        label = f'context switches of a tick, {name}'
        found.append(Figure(f'{name}_switches', label, '', switches, 25.0, 15.0, at_most=True))
        times = [run.start_s for run in runs]
        found.append(Figure(f'{name}_start_s', f'start and end, {name}', SECONDS, times))
    return found


def _ratios(measurements: Measurements, name: str, other: str) -> list[float]:
    pairs = zip(measurements[name], measurements[other], strict=True)
    return [one.real_time_factor / two.real_time_factor for one, two in pairs]


if __name__ == '__main__':
    sys.exit(invoke(bench, 'scripts/bench', failed=1))
