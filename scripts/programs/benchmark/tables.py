"""Tables of the experiments."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import click


def print_table(head: Sequence[str], rows: Iterable[Sequence[object]]) -> None:
    """Print a Markdown table."""
    for row in (head, ['---'] * len(head), *rows):
        click.echo(f'| {" | ".join(map(str, row))} |')
