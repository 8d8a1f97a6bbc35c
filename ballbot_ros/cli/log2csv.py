"""`ballbot log2csv`: the data log of a recording as CSV."""

from __future__ import annotations

from pathlib import Path

import click

from ballbot_ros.analysis.data_log import write_data_log
from ballbot_ros.cli.options import NEW_FILE, RECORDING
from ballbot_ros.recording.messages.recording_files import open_recording


@click.command('log2csv')
@click.argument('recording', type=RECORDING)
@click.option(
    '--output',
    type=NEW_FILE,
    help='File to write.  [default: RECORDING with the suffix .csv]',
)
def command(recording: Path, output: Path | None) -> None:
    """Write the brick's data log in RECORDING as CSV, with a file for each run."""
    with open_recording(recording) as reader:
        written = write_data_log(reader, output or recording.with_suffix('.csv'))
        if written.malformed:
            noun = 'packet' if written.malformed == 1 else 'packets'
            click.echo(
                f'{written.topic}: skipped {written.malformed} malformed log {noun}', err=True
            )
        if reader.damage:
            click.echo(f'{recording}: {reader.damage}', err=True)
    for path in written.paths:
        click.echo(f'data log  {path}')
