"""Identification of robots whose parameters are known: how often the intervals cover them.

The parameters of each robot are drawn at random around the document's. It drives the scenario
`excitation`; what a brick measures meanwhile is all that the identification is given, with the
document's values to begin with: once a recording, once the brick's data log.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import NamedTuple

import click
import numpy as np

from ballbot_ros.analysis.data_log import read_data_log, write_data_log
from ballbot_ros.analysis.identification.experiment import (
    Experiment,
    logged_experiment,
    recorded_experiment,
)
from ballbot_ros.analysis.identification.identification import Identification, identify
from ballbot_ros.analysis.run_data import RunData, read_run
from ballbot_ros.files import temporary_folder
from ballbot_ros.parameters import PLANT, PlantParameters
from ballbot_ros.recording.reader import RecordingReader
from ballbot_ros.run.library import simulate
from benchmark.tables import print_table

SPREAD = 0.1
"""Largest deviation of a parameter, as a part of its value."""

SCENARIO = 'excitation'
FALLEN_DEG = 30.0

NAMES = ('body_height', 'back_emf_constant', 'torque_constant', 'dead_zone')
"""Parameters that are drawn: those that the data tell apart."""

SOURCES: dict[str, Callable[[RunData, Path], Experiment]] = {
    'recording': lambda run, log: recorded_experiment(run, {}),
    'data log': lambda run, log: logged_experiment(log, {'backlash': run.plant.backlash}),
    'data log, gear play not known': lambda run, log: logged_experiment(log, {}),
}
"""Experiments from which a robot is identified, each of a run and its data log."""

HARDWARE_VALUES = {
    'body_height': 0.17, 'back_emf_constant': 0.468, 'torque_constant': 0.317, 'dead_zone': 4.0,
    'body_mass': 0.682, 'motor_friction': 0.0022,
}  # fmt: skip
"""Values around which robots are drawn: those of the profile `hardware`."""


class Case(NamedTuple):
    """A robot, and what was identified.

    Attributes
    ----------
    robot : PlantParameters
    found : mapping of str to Identification
        By the source of the data; empty if the robot fell.
    """

    robot: PlantParameters
    found: Mapping[str, Identification]


def case(number: int, names: Sequence[str]) -> Case:
    """Draw a robot, whose parameters of these names differ from the document's, and identify it.

    `number`, from 0, selects the random numbers.
    """
    random = np.random.default_rng(number)
    values = {
        f'{PLANT}.{name}': HARDWARE_VALUES[name] * (1.0 + SPREAD * random.uniform(-1.0, 1.0))
        for name in names
    }
    run = simulate(SCENARIO, seed=number + 1, parameters=values)
    with temporary_folder() as folder:
        path = run.save(f'{folder}/{number}.mcap')
        recording = read_run(path)
        if run.metrics['peak_pitch_deg'] > FALLEN_DEG:
            return Case(recording.plant, {})
        with RecordingReader(path) as reader:
            (log,) = write_data_log(read_data_log(reader), path.with_suffix('.csv'))
        found = {
            source: identify([experiment(recording, log)]) for source, experiment in SOURCES.items()
        }
        return Case(recording.plant, found)


def cases(count: int, names: Sequence[str]) -> Iterator[Case]:
    """Yield so many cases."""
    with ProcessPoolExecutor(2) as pool:
        yield from pool.map(case, range(count), [names] * count)


class Estimate(NamedTuple):
    """An estimate: its error and half of its interval, as parts of a usual value."""

    error: float
    half_width: float


def identification(robots: int) -> None:
    """Identify robots drawn at random; count how often the 95 % intervals cover the true values."""
    estimates: dict[tuple[str, str], list[Estimate]] = {}
    falls = count = 0
    for each in cases(robots, NAMES):
        count += 1
        falls += not each.found
        for source, found in each.found.items():
            for row in found.estimated:
                assert row.value is not None
                error = abs(row.value - getattr(each.robot, row.name)) / row.half_width
                estimate = Estimate(error * row.relative, row.relative)
                estimates.setdefault((source, row.name), []).append(estimate)
    rows = []
    for (source, name), known in sorted(estimates.items(), key=lambda item: item[0][0]):
        covered = sum(each.error <= each.half_width for each in known)
        widths = [each.half_width for each in known]
        rows.append((
            source, f'`{name}`', f'{len(known)} of {count}', f'{covered} of {len(known)}',
            f'±{100.0 * np.median(widths):.2f} %', f'±{100.0 * max(widths):.2f} %',
            f'{100.0 * max(each.error for each in known):.2f} %',
        ))  # fmt: skip
    print_table(
        ('from', 'parameter', 'identified', 'covered', 'median interval', 'widest',
         'largest error'),
        rows,
    )  # fmt: skip
    click.echo(f'\n{falls} of {count} robots fell.')
