"""The data log in a recording, and its conversion to CSV, in the format of the gamepad node."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from ballbot_ros.analysis.recorded_runs import robot_namespace
from ballbot_ros.errors import RecordingError
from ballbot_ros.parameters.timing import MILLISECOND_NS
from ballbot_ros.recording.csv_log import CsvLog
from ballbot_ros.recording.messages.conversions import log_packet, time_ns
from ballbot_ros.recording.messages.topics import BLUETOOTH_TX, RUN
from ballbot_ros.recording.reader import RecordingReader
from ballbot_ros.robot.brick.bluetooth import LogPacket, PacketError


@dataclass(frozen=True)
class DataLogFiles:
    """The written files, one per run, and the number of malformed packets."""

    paths: Sequence[Path]
    topic: str
    malformed: int


def last_log(reader: RecordingReader) -> list[LogPacket]:
    """Return the log packets of the last run of a real robot."""
    namespace = robot_namespace(reader, [BLUETOOTH_TX]) or ''
    packets, runs = BLUETOOTH_TX.resolved(namespace), RUN.resolved(namespace)
    found: list[LogPacket] = []
    for topic, _, message in reader.messages({packets, runs} & reader.topics().keys()):
        if topic == runs:
            found = []
            continue
        with suppress(PacketError):
            found.append(log_packet(message))
    return found


def write_data_log(reader: RecordingReader, output: Path) -> DataLogFiles:
    """Write the log packets of a recording as CSV, one file per run.

    Raises
    ------
    RecordingError
        If there is no topic of log packets, or a message can't be read; no file remains then.
    """
    namespace = robot_namespace(reader, [BLUETOOTH_TX])
    if namespace is None:
        names = ', '.join(sorted(reader.topics())) or 'none'
        raise RecordingError(
            f'{reader.path}: topic {BLUETOOTH_TX.name!r} not found; the file has {names}'
        )
    packets, runs = BLUETOOTH_TX.resolved(namespace), RUN.resolved(namespace)
    log, malformed = CsvLog(output), 0
    try:
        for topic, _, message in reader.messages({packets, runs} & reader.topics().keys()):
            if topic == runs:
                log.begin_run(time_ns(message.stamp) // MILLISECOND_NS)
                continue
            try:
                log.write(log_packet(message))
            except PacketError:
                malformed += 1
    except RecordingError:
        log.close()
        for path in log.paths:
            path.unlink()
        raise
    log.close()
    return DataLogFiles(log.paths, packets, malformed)
