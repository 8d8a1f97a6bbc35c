"""`ballbot log2csv`: the data log of a recording, as the gamepad node writes it live."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import click

from ballbot_ros.analysis.namespace import robot_namespace
from ballbot_ros.brick.bluetooth import PacketError
from ballbot_ros.cli.path_types import NEW_FILE, RECORDING
from ballbot_ros.messages.conversions import log_packet, time_ns
from ballbot_ros.messages.topics import BLUETOOTH_TX, RUN
from ballbot_ros.recording.errors import RecordingError
from ballbot_ros.recording.reader import RecordingReader
from ballbot_ros.simulation.timing import MILLISECOND_NS
from ballbot_ros.teleop.csv_log import CsvLog

_Message = tuple[str, int, Any]


@click.command('log2csv')
@click.argument('recording', type=RECORDING)
@click.option(
    '--output',
    type=NEW_FILE,
    help='File to write.  [default: RECORDING with the suffix .csv]',
)
def command(recording: Path, output: Path | None) -> None:
    """Write the data log that the brick sent in RECORDING as CSV, a file for each run in it."""
    with RecordingReader(recording) as reader:
        namespace = robot_namespace(reader, [BLUETOOTH_TX])
        if namespace is None:
            names = ', '.join(sorted(reader.topics())) or 'none'
            raise RecordingError(
                f'{recording}: no topic {BLUETOOTH_TX.name!r}, one is needed; there are {names}'
            )
        packets, runs = BLUETOOTH_TX.resolved(namespace), RUN.resolved(namespace)
        topics = {packets, runs} & reader.topics().keys()
        log = CsvLog(output or recording.with_suffix('.csv'))
        malformed = 0
        for topic, _, message in _complete(reader.messages(topics), log):
            if topic == runs:
                log.begin_run(time_ns(message.stamp) // MILLISECOND_NS)
                continue
            try:
                log.write(log_packet(message))
            except PacketError:
                malformed += 1
        log.close()
        if malformed:
            click.echo(f'{packets}: {malformed} messages are no log packets: left out', err=True)
        if reader.damage:
            click.echo(f'{recording}: {reader.damage}', err=True)
    for path in log.paths:
        click.echo(f'data log  {path}')


def _complete(messages: Iterator[_Message], log: CsvLog) -> Iterator[_Message]:
    """Iterate over the messages; where one can't be read, leave no file behind."""
    try:
        yield from messages
    except RecordingError:
        log.close()
        for path in log.paths:
            path.unlink()
        raise
