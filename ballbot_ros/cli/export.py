"""`ballbot export`: a recording as tables."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import click
from rich.console import Console

from ballbot_ros.cli.options import PATH, RECORDING, Choice, split_at_commas
from ballbot_ros.cli.progress import file_progress
from ballbot_ros.errors import RecordingError
from ballbot_ros.parameters.timing import TICK_NS
from ballbot_ros.recording.columns import load_pyarrow
from ballbot_ros.recording.export import Exporter
from ballbot_ros.recording.messages.column_hints import column_hints
from ballbot_ros.recording.messages.recording_files import open_recording
from ballbot_ros.recording.messages.topics import OPERATING_STATE
from ballbot_ros.recording.reader import RecordingReader


@click.command('export')
@click.argument('file', type=RECORDING)
@click.option(
    '--to', 'file_format', type=Choice(['csv', 'parquet']), required=True, help='File format.'
)
@click.option(
    '--output', type=PATH, help='Folder for the tables.  [default: FILE_csv or FILE_parquet]'
)
@click.option(
    '--joined', is_flag=True, help='One table with a row per tick (4 ms) instead of one per topic.'
)
@click.option(
    '--topics',
    multiple=True,
    callback=split_at_commas,
    metavar='TOPIC[,TOPIC…]',
    help='The topics to export; can be repeated.  [default: all that are not derived from others]',
)
def command(
    file: Path, file_format: str, output: Path | None, joined: bool, topics: list[str]
) -> None:
    """Write the recording FILE as tables with SI units in the column names."""
    if file_format == 'parquet':
        load_pyarrow()
    console = Console(stderr=True, highlight=False, markup=False, soft_wrap=True)
    folder = output or file.with_name(f'{file.stem}_{file_format}')
    with open_recording(file) as reader, file_progress(f'exporting {file.name}') as progress:
        exporter = Exporter(
            reader,
            folder,
            file_format,
            _chosen(reader, topics, console),
            column_hints(),
            progress,
        )
        if joined:
            exporter.write_joined(TICK_NS, [OPERATING_STATE.resolved()])
        else:
            exporter.write_topics()
        if reader.damage:
            console.print(f'{file}: {reader.damage}; the tables have the rest')
    if not exporter.files:
        raise RecordingError(f'{file}: no messages to export')
    for table in exporter.files:
        print(table)


def _chosen(reader: RecordingReader, topics: Sequence[str], console: Console) -> list[str]:
    reader.check_topics(topics)
    unreadable = reader.unreadable()
    for topic in unreadable:
        if topic in topics:
            raise RecordingError(f'{reader.path}: {topic}: {unreadable[topic]}')
        if not topics:
            console.print(f'{reader.path}: {topic} skipped: {unreadable[topic]}')
    return list(topics) or sorted(reader.topics().keys() - unreadable.keys() - reader.derived())
