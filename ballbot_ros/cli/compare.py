"""`ballbot compare`: recorded runs side by side, and a gate against regressions."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from string import ascii_uppercase

import click
from rich.console import Console
from rich.table import Table

from ballbot_ros.analysis.comparison import (
    Compared,
    as_json,
    compared,
    failures,
    rows,
    write_comparison,
)
from ballbot_ros.analysis.conditions import parse_condition
from ballbot_ros.analysis.page import ReportError, check_folder
from ballbot_ros.analysis.report import MEANINGS
from ballbot_ros.cli.reading import read_and_assess

WIDEST = 2000


def compare(
    recordings: Sequence[Path],
    *,
    output: Path | None,
    conditions: Sequence[str],
    as_json: bool,
) -> int:
    """Compare recordings with the first; return 1 if a condition holds, otherwise 0."""
    if not 2 <= len(recordings) <= len(ascii_uppercase):
        raise ReportError(f'compare takes 2 … {len(ascii_uppercase)} recordings, not '
                          f'{len(recordings)}')  # fmt: skip
    parsed = [parse_condition(text, MEANINGS) for text in conditions]
    if output:
        check_folder(output)
    runs = []
    for letter, path in zip(ascii_uppercase, recordings, strict=False):
        runs.append(compared(letter, read_and_assess(path)))
        for line in runs[-1].notes:
            click.echo(f'note: {runs[-1].label}: {line}', err=True)
    failed = failures(runs, parsed)
    if output:
        write_comparison(runs, failed, output)
    if as_json:
        _print_json(runs, failed)
    else:
        _print_table(runs)
        for line in failed:
            click.echo(f'failed  {line}')
        if output:
            click.echo(f'comparison  {output / "index.html"}')
    return 1 if failed else 0


def _print_json(runs: Sequence[Compared], failed: Sequence[str]) -> None:
    click.echo(json.dumps(as_json(runs, failed), indent=2, allow_nan=False))


def _print_table(runs: Sequence[Compared]) -> None:
    console = Console(highlight=False, markup=False)
    for each in runs:
        reason = f': {each.reason}' if each.reason else ''
        console.print(f'{each.letter}  {each.path}  {each.outcome}{reason}', soft_wrap=True)
    table = Table()
    table.add_column('metric')
    table.add_column('unit')
    table.add_column(runs[0].letter, justify='right')
    for each in runs[1:]:
        for heading in (each.letter, f'{each.letter} − {runs[0].letter}', 'change'):
            table.add_column(heading, justify='right')
    for row in rows(runs):
        cells = [cell for o in row['others'] for cell in (o['value'], o['change'], o['percent'])]
        table.add_row(row['label'], row['unit'], row['value'], *cells)
    # A number that is cut short is worse than a line that the terminal breaks.
    whole = console.measure(table, options=console.options.update(max_width=WIDEST)).maximum
    console.width = max(console.width, whole)
    console.print(table)
