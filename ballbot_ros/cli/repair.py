"""`ballbot repair`: recovery of a damaged recording."""

from __future__ import annotations

from pathlib import Path

import click
from rich.console import Console

from ballbot_ros.cli.file_progress import file_progress
from ballbot_ros.cli.path_types import NEW_FILE, RECORDING
from ballbot_ros.recording.repair import repair


@click.command('repair')
@click.argument('file', type=RECORDING)
@click.option(
    '--output',
    type=NEW_FILE,
    help='File to write, which must not exist.  [default: FILE_repaired.mcap next to it]',
)
def command(file: Path, output: Path | None) -> None:
    """Copy the intact part of the damaged recording FILE to a new one, and list what is lost."""
    with file_progress(f'repairing {file.name}') as progress:
        found = repair(file, output, progress)
    console = Console(highlight=False, markup=False, soft_wrap=True)
    if found.output is None:
        console.print(f'{file}: no repair needed, {found.message_count} messages intact')
        return
    console.print(f'{file}:')
    for damage in found.damage:
        console.print(f'  {damage}')
    for span in found.spans:
        console.print(f'  messages lost {span}')
    for topic, lost in found.lost.items():
        console.print(f'  {topic}: {lost} lost')
    if found.nothing_lost:
        console.print('  no message lost')
    elif not found.lost:
        console.print('  number of lost messages unknown')
    console.print(f'{found.message_count} messages intact: {found.output}')
