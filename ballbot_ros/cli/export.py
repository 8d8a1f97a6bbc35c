"""`ballbot export`: a recording as tables, or its data log."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import click
from rich.console import Console

from ballbot_ros.analysis.data_log import read_data_log, write_data_log
from ballbot_ros.cli.options import RECORDING, Choice, folder_option, split_at_commas
from ballbot_ros.cli.progress import file_progress
from ballbot_ros.errors import RecordingError, os_errors
from ballbot_ros.parameters.timing import TICK_NS
from ballbot_ros.recording.columns import load_pyarrow
from ballbot_ros.recording.export import Exporter
from ballbot_ros.recording.messages.column_hints import column_hints
from ballbot_ros.recording.messages.recording_files import open_recording
from ballbot_ros.recording.messages.topics import OPERATING_STATE
from ballbot_ros.recording.reader import RecordingReader

LOG = 'log'


@click.command('export')
@click.argument('file', type=RECORDING)
@click.option(
    '--to',
    'file_format',
    type=Choice(['csv', 'parquet', LOG]),
    required=True,
    help="Tables as CSV or Parquet, or the brick's data log as CSV, a file for each run (log).",
)
@folder_option('the files.  [default: FILE_csv, FILE_parquet or FILE_log]')
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
    """Write the recording FILE as tables with SI units in the column names, or its data log."""
    if file_format == 'parquet':
        load_pyarrow()
    console = Console(stderr=True, highlight=False, markup=False, soft_wrap=True)
    folder = output or file.with_name(f'{file.stem}_{file_format}')
    if file_format == LOG:
        if joined or topics:
            raise click.UsageError(f'--to {LOG}: takes neither --joined nor --topics')
        _write_log(file, folder, console)
        return
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


def _write_log(file: Path, folder: Path, console: Console) -> None:
    with open_recording(file) as reader:
        log, damage = read_data_log(reader), reader.damage
    with os_errors(RecordingError, folder):
        folder.mkdir(parents=True, exist_ok=True)
    paths = write_data_log(log, folder / f'{file.stem}.csv')
    if log.malformed:
        console.print(f'{file}: skipped {log.malformed} malformed log packets')
    if damage:
        console.print(f'{file}: {damage}; the log has the rest')
    for path in paths:
        print(path)


def _chosen(reader: RecordingReader, topics: Sequence[str], console: Console) -> list[str]:
    reader.check_topics(topics)
    unreadable = reader.unreadable()
    for topic in unreadable:
        if topic in topics:
            raise RecordingError(f'{reader.path}: {topic}: {unreadable[topic]}')
        if not topics:
            console.print(f'{reader.path}: {topic} skipped: {unreadable[topic]}')
    return list(topics) or sorted(reader.topics().keys() - unreadable.keys() - reader.derived())
