"""`ballbot compare`: comparison of recorded runs, and a check for regressions."""

from __future__ import annotations

import json
from collections.abc import Sequence
from itertools import chain
from pathlib import Path
from string import ascii_uppercase
from typing import TYPE_CHECKING

import click
from rich.console import Console
from rich.table import Column, Table

from ballbot_ros.cli.options import RECORDING, folder_option, print_whole

if TYPE_CHECKING:
    from ballbot_ros.analysis.comparison import ComparedRun, Comparison, MetricComparison


@click.command('compare')
@click.argument('recordings', nargs=-1, required=True, type=RECORDING, metavar='A B...')
@folder_option('a page with the figures of all runs; it must be new or empty.')
@click.option(
    '--fail-if',
    'conditions',
    multiple=True,
    metavar="'METRIC>X%'",
    help='Exit with 1 if METRIC of any later run is larger than that of the first by more than X '
    'percent, or without % by more than X of its unit; < for smaller.  Can be repeated.',
)
@click.option(
    '--all', 'with_same', is_flag=True, help='Show the metrics without a difference, too.'
)
@click.option('--json', 'as_json', is_flag=True, help='Print one JSON object.')
def command(
    recordings: tuple[Path, ...],
    output: Path | None,
    conditions: tuple[str, ...],
    with_same: bool,
    as_json: bool,
) -> int:
    """Compare recorded runs with the first one, A; a branch alone with the run that it is of.

    Exit status: 0; 1 if a --fail-if condition holds; 2 for invalid arguments or a file that is not
    a recording of a ballbot.
    """
    # Imported only here: it takes half a second.
    from ballbot_ros.analysis import comparison
    from ballbot_ros.analysis.comparison import parse_condition
    from ballbot_ros.analysis.page import ReportError, check_folder
    from ballbot_ros.analysis.report import MEANINGS
    from ballbot_ros.cli.recordings import parent_of, read_and_assess

    if len(recordings) == 1 and (parent := parent_of(recordings[0])):
        recordings = (parent[0], *recordings)
    if not 2 <= len(recordings) <= len(ascii_uppercase):
        raise ReportError(f'compare takes 2 … {len(ascii_uppercase)} recordings, not '
                          f'{len(recordings)}')  # fmt: skip
    parsed = [parse_condition(text, MEANINGS) for text in conditions]
    if output:
        check_folder(output)
    runs = []
    for letter, path in zip(ascii_uppercase, recordings, strict=False):
        runs.append(comparison.ComparedRun.from_assessment(letter, read_and_assess(path)))
        for line in runs[-1].notes:
            click.echo(f'note: {letter} {path}: {line}', err=True)
    compared = comparison.Comparison.of(runs)
    failed = comparison.failures(compared, parsed)
    if output:
        comparison.write_comparison(compared, failed, output)
    if as_json:
        click.echo(json.dumps(comparison.as_json(compared, failed), indent=2, allow_nan=False))
    else:
        print_changes(compared, comparison.NOTHING_CHANGED)
        print_table(runs, comparison.metric_comparisons(compared.runs), with_same=with_same)
        for line in failed:
            click.echo(f'failed  {line}')
        if output:
            click.echo(f'comparison  {output / "index.html"}')
    return 1 if failed else 0


def print_changes(comparison: Comparison, nothing: str) -> None:
    """Print what was changed, or that it is `nothing`, and the runs with their verdicts."""
    console = Console(highlight=False, markup=False, soft_wrap=True)
    rows = comparison.change_rows
    width = max((len(name) for name, _ in rows), default=0)
    if rows or not comparison.alignment:
        console.print('changed' if rows else nothing)
    for name, text in rows:
        console.print(f'  {name:<{width}}  {text}')
    for label, each in zip(comparison.labels, comparison.runs, strict=True):
        reason = f': {each.reason}' if each.reason else ''
        controller = f'  {each.controller}' if each.controller else ''
        console.print(f'{label}  {each.path}{controller}  {each.outcome}{reason}')
    for line in filter(None, (comparison.identical, comparison.alignment, *comparison.apart)):
        console.print(line)


def print_table(
    runs: Sequence[ComparedRun], rows: Sequence[MetricComparison], *, with_same: bool
) -> None:
    """Print the metrics that differ, or all of them."""
    shown = [row for row in rows if with_same or not row.is_same]
    console = Console(highlight=False, markup=False)
    table = Table('metric', 'unit', Column(runs[0].letter, justify='right'))
    for each in runs[1:]:
        for heading in (each.letter, f'{each.letter} − {runs[0].letter}', 'change'):
            table.add_column(heading, justify='right')
    for row in shown:
        text = row.text
        table.add_row(text.label, text.unit, text.value, *chain.from_iterable(row.changes))
    if shown:
        print_whole(console, table)
    if hidden := len(rows) - len(shown):
        console.print(f'{hidden} metrics without a difference; --all shows them', soft_wrap=True)
