"""The data log in a recording, and its conversion to CSV, in the format of the PC tool."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

from ballbot_ros.analysis.recorded_runs import robot_namespace
from ballbot_ros.errors import RecordingError
from ballbot_ros.recording.csv_log import write_csv_log
from ballbot_ros.recording.messages.conversions import log_packet
from ballbot_ros.recording.messages.topics import BLUETOOTH_TX, RUN
from ballbot_ros.recording.reader import RecordingReader
from ballbot_ros.robot.brick.bluetooth import LogPacket, PacketError


class DataLog(NamedTuple):
    """The log packets of each run that has some, and the number of malformed packets."""

    runs: list[list[LogPacket]]
    malformed: int


def read_data_log(reader: RecordingReader) -> DataLog:
    """Return the log packets in a recording.

    It raises RecordingError if there is no topic of log packets, or a message can't be read.
    """
    namespace = robot_namespace(reader, [BLUETOOTH_TX])
    if namespace is None:
        names = ', '.join(sorted(reader.topics())) or 'none'
        raise RecordingError(
            f'{reader.path}: topic {BLUETOOTH_TX.name!r} not found; the file has {names}'
        )
    packets, announced = BLUETOOTH_TX.resolved(namespace), RUN.resolved(namespace)
    runs: list[list[LogPacket]] = []
    malformed, begins_ns = 0, 0
    for topic, log_ns, message in reader.messages({packets, announced} & reader.topics().keys()):
        if topic == announced:
            begins_ns = log_ns
            continue
        # The announcement of a run can overtake the last packets of the run before.
        if not runs or 0 < begins_ns <= log_ns:
            runs.append([])
            begins_ns = 0
        try:
            runs[-1].append(log_packet(message))
        except PacketError:
            malformed += 1
    return DataLog([each for each in runs if each], malformed)


def last_log(reader: RecordingReader) -> list[LogPacket]:
    """Return the log packets of the last run of a real robot."""
    *_, last = [], *read_data_log(reader).runs
    return last


def write_data_log(log: DataLog, path: Path) -> list[Path]:
    """Write a log as CSV files, one for each run: the path, ``…_2.csv`` and so on; return them.

    It raises RecordingError if a file already exists or can't be written.
    """
    paths = [path.with_name(f'{path.stem}_{n}{path.suffix}') for n in range(2, len(log.runs) + 1)]
    for each, packets in zip((path, *paths), log.runs, strict=False):
        write_csv_log(each, packets)
    return [path, *paths][: len(log.runs)]
