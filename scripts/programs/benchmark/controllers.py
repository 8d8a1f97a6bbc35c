"""Compares the controllers that ship by ``ballbot compare``: ``python -m benchmark.controllers``.

It writes the tables of docs/controllers.md. Seeds are fixed, so each call writes the same tables.
"""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import click

from ballbot_ros.cli.command import invoke
from ballbot_ros.engine.scenario.reader import scenario_names

PAGE = Path(__file__).parents[3] / 'docs' / 'controllers.md'
BEGIN, END = '<!-- figures: begin -->\n', '<!-- figures: end -->\n'
BALLBOT = (sys.executable, '-m', 'ballbot_ros.cli.main')
GAINS = Path(__file__).parents[3] / 'config/gains'
CONTROLLERS = {
    'document': ('--params', str(GAINS / 'document.yaml')),
    'quiet': ('--params', str(GAINS / 'quiet.yaml')),
    **{name: ('--controller', name) for name in ('pid', 'lqg', 'drift_filter', 'mpc')},
}
"""The columns: options of a run."""
PROFILES = ('ideal', 'hardware')
LONG, LONG_S, LONG_SEEDS = 'hardware_standing', 300, (1, 2, 3)


class Metric(NamedTuple):
    """A metric of a table: its name in the JSON, and the digits to show."""

    name: str
    digits: int


METRICS = (Metric('duty_rms_percent', 1), Metric('energy_j', 2), Metric('peak_pitch_deg', 1))
LONG_METRICS = {
    'duty RMS [%]': Metric('duty_rms_percent', 1),
    'energy [J]': Metric('energy_j', 1),
    'largest pitch [deg]': Metric('peak_pitch_deg', 2),
    'farthest from the start [m]': Metric('peak_position_m', 3),
    'error of the estimated pitch, RMS [deg]': Metric('pitch_error_rms_deg', 2),
}


def compare(
    folder: Path, scenario: str, *options: str, controllers: Iterable[str] = CONTROLLERS
) -> dict[str, Any]:
    """Run a scenario with every controller; return the comparison as JSON."""
    recordings = []
    for controller in controllers:
        output = folder / controller
        words = ['run', scenario, '--processes', 'none', '--json', *CONTROLLERS[controller]]
        words += ['--output', str(output), *options]
        done = subprocess.run([*BALLBOT, *words], capture_output=True, text=True, check=False)
        if done.returncode not in (0, 1):
            raise click.ClickException(done.stderr.strip())
        recordings.append(str(output / f'{scenario}.mcap'))
    words = [*BALLBOT, 'compare', '--json', *recordings]
    done = subprocess.run(words, capture_output=True, text=True, check=True)
    comparison: dict[str, Any] = json.loads(done.stdout)
    return comparison


def cells(comparison: dict[str, Any]) -> list[str]:
    """Return what a comparison shows in the row of a scenario."""
    found = []
    for number, run in enumerate(comparison['runs']):
        values = [
            _text(comparison['metrics'][name]['values'][number], digits) for name, digits in METRICS
        ]
        missed = '' if run['outcome'] == 'passed' else ' ✗'
        found.append(' / '.join(values) + missed)
    return found


def scenario_table(folder: Path) -> Iterator[str]:
    """Yield the lines of the table of all scenarios with both profiles."""
    yield _row(['scenario', 'profile', *CONTROLLERS])
    yield _row(['---'] * (2 + len(CONTROLLERS)))
    for scenario in scenario_names():
        for profile in PROFILES:
            click.echo(f'{scenario}, {profile}', err=True)
            comparison = compare(folder / f'{scenario}_{profile}', scenario, '--profile', profile)
            yield _row([f'`{scenario}`', profile, *cells(comparison)])


def long_table(folder: Path) -> Iterator[str]:
    """Yield the lines of the table of standing for a long time."""
    yield _row(['', *CONTROLLERS])
    yield _row(['---'] * (1 + len(CONTROLLERS)))
    comparisons = []
    for seed in LONG_SEEDS:
        click.echo(f'{LONG} for {LONG_S} s, seed {seed}', err=True)
        options = ('--set', f'plant_sim.duration={LONG_S}', '--seed', str(seed))
        comparisons.append(compare(folder / f'long_{seed}', LONG, *options))
    stood = [
        sum(each['runs'][number]['outcome'] == 'passed' for each in comparisons)
        for number, _ in enumerate(CONTROLLERS)
    ]
    yield _row(['runs that meet all expectations', *(f'{n} of {len(LONG_SEEDS)}' for n in stood)])
    for label, (name, digits) in LONG_METRICS.items():
        values = [
            [each['metrics'][name]['values'][number] for each in comparisons]
            for number, _ in enumerate(CONTROLLERS)
        ]
        yield _row([label, *(_range(each, digits) for each in values)])


def _text(value: float | None, digits: int) -> str:
    return '–' if value is None else f'{value:.{digits}f}'


def _range(values: Sequence[float | None], digits: int) -> str:
    known = sorted({_text(each, digits) for each in values}, key=lambda text: (len(text), text))
    return known[0] if len(known) == 1 else f'{known[0]} to {known[-1]}'


def _row(texts: Sequence[str]) -> str:
    return f'| {" | ".join(texts)} |\n'


@click.command()
@click.option('--print', 'only_print', is_flag=True, help='Print the tables; write nothing.')
def main(only_print: bool) -> None:
    """Run every scenario with every controller, and write the tables of docs/controllers.md."""
    with TemporaryDirectory() as name:
        folder = Path(name)
        scenarios, standing = ''.join(scenario_table(folder)), ''.join(long_table(folder))
    seeds = ', '.join(map(str, LONG_SEEDS))
    caption = f'Standing for {LONG_S} s, `{LONG}`, seeds {seeds} (smallest to largest):'
    tables = f'\n{scenarios}\n{caption}\n\n{standing}\n'
    if only_print:
        click.echo(tables)
        return
    before, _, rest = PAGE.read_text(encoding='utf-8').partition(BEGIN)
    _, _, after = rest.partition(END)
    PAGE.write_text(f'{before}{BEGIN}{tables}{END}{after}', encoding='utf-8')


if __name__ == '__main__':
    sys.exit(invoke(main, 'scripts/controllers'))
