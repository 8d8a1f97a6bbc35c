"""`ballbot repair`: recovery of a damaged recording."""

from __future__ import annotations

from pathlib import Path

import click
from rich.console import Console

from ballbot_ros.cli.options import NEW_FILE, RECORDING
from ballbot_ros.cli.progress import file_progress
from ballbot_ros.recording.repair import repair


@click.command('repair')
@click.argument('file', type=RECORDING)
@click.option(
    '--output',
    type=NEW_FILE,
    help='File to write, which must not exist.  [default: FILE_repaired.mcap next to it]',
)
def command(file: Path, output: Path | None) -> None:
    """Copy the damaged recording FILE, up to the damage, to a new one that every program reads."""
    with file_progress(f'repairing {file.name}') as progress:
        found = repair(file, output, progress)
    console = Console(highlight=False, markup=False, soft_wrap=True)
    console.print(f'{file}: {found.description}')
    if found.output:
        console.print(f'repaired  {found.output}')
