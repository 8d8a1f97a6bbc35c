"""Identification of robots whose parameters are known: how often the intervals cover them.

The parameters of each robot are drawn at random around the document's. It drives the scenario
`excitation`; what a brick measures meanwhile is all that the identification is given, with the
document's values to begin with.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from typing import NamedTuple

import click
import numpy as np

from ballbot_ros.analysis.run_data import read_run
from ballbot_ros.files import temporary_folder
from ballbot_ros.identification.identification import (
    Identification,
    IdentifiedParameter,
    identify,
)
from ballbot_ros.identification.recorded_experiment import recorded_experiment
from ballbot_ros.parameters import PLANT
from ballbot_ros.run.library import simulate
from benchmark.tables import print_table

SPREAD = 0.1
"""Largest deviation of a parameter, as a part of its value."""

SCENARIO = 'excitation'
FALLEN_DEG = 30.0

NAMES = ('body_height', 'back_emf_constant', 'torque_constant', 'dead_zone')
"""Parameters that are drawn: those that the data tell apart."""

HARDWARE_VALUES = {
    'body_height': 0.17, 'back_emf_constant': 0.468, 'torque_constant': 0.317, 'dead_zone': 4.0,
    'body_mass': 0.682, 'motor_friction': 0.0022,
}  # fmt: skip
"""Values around which robots are drawn: those of the profile `hardware`."""


class Case(NamedTuple):
    """A robot, and what was identified.

    Attributes
    ----------
    number : int
        From 0; it selects the random numbers.
    identification : Identification or None
        None if the robot fell.
    """

    number: int
    identification: Identification | None


def case(number: int, names: Sequence[str]) -> Case:
    """Draw a robot, whose parameters of these names differ from the document's, and identify it."""
    random = np.random.default_rng(number)
    values = {
        f'{PLANT}.{name}': HARDWARE_VALUES[name] * (1.0 + SPREAD * random.uniform(-1.0, 1.0))
        for name in names
    }
    run = simulate(SCENARIO, seed=number + 1, parameters=values)
    if run.metrics['peak_pitch_deg'] > FALLEN_DEG:
        return Case(number, None)
    with temporary_folder() as folder:
        data = read_run(run.save(f'{folder}/{number}.mcap'))
    return Case(number, identify([recorded_experiment(data, {})]))


def cases(count: int, names: Sequence[str]) -> Iterator[Case]:
    """Yield so many cases."""
    with ProcessPoolExecutor(2) as pool:
        yield from pool.map(case, range(count), [names] * count)


def identification(robots: int) -> None:
    """Identify robots drawn at random; count how often the 95 % intervals cover the true values."""
    found: dict[str, list[IdentifiedParameter]] = {}
    falls = count = 0
    for each in cases(robots, NAMES):
        count += 1
        if each.identification is None:
            falls += 1
            continue
        for parameter in each.identification.estimated:
            found.setdefault(parameter.name, []).append(parameter)
    rows = []
    for name, estimates in found.items():
        covered = sum(bool(each.covers_recorded) for each in estimates)
        errors = [
            abs(each.value / each.recorded - 1.0)
            for each in estimates
            if each.value is not None and each.recorded
        ]
        widths = [each.relative for each in estimates]
        rows.append((
            f'`{name}`', f'{len(estimates)} of {count}', f'{covered} of {len(estimates)}',
            f'±{100.0 * np.median(widths):.2f} %', f'±{100.0 * max(widths):.2f} %',
            f'{100.0 * max(errors):.2f} %',
        ))  # fmt: skip
    print_table(
        ('parameter', 'identified', 'covered', 'median interval', 'widest', 'largest error'),
        rows,
    )
    click.echo(f'\n{falls} of {count} robots fell.')
