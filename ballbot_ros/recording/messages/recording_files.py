"""Opening recordings: MCAP files, and the CSV of a brick's data log."""

from __future__ import annotations

import os
from pathlib import Path

from ballbot_ros.errors import RecordingError, os_errors
from ballbot_ros.files import open_regular, temporary_folder
from ballbot_ros.parameters import LogFormat
from ballbot_ros.parameters.timing import MILLISECOND_NS
from ballbot_ros.recording.csv_log import HEADER, read_csv_log
from ballbot_ros.recording.messages.brick_messages import BrickMessages
from ballbot_ros.recording.reader import RecordingReader
from ballbot_ros.recording.writer import RecordingWriter
from ballbot_ros.robot.brick.bluetooth import elapsed


def open_recording(path: str | os.PathLike[str]) -> RecordingReader:
    """Open an MCAP file, or a data log as the recording that a link to the brick would have made.

    It raises RecordingError as :class:`RecordingReader`, and for a data log that is malformed or
    has no packets.
    """
    path = Path(path)
    with os_errors(RecordingError, path), open_regular(path) as file:
        is_log = file.read(len(HEADER)) == HEADER.encode()
    if not is_log and path.suffix.lower() != '.csv':
        return RecordingReader(path)
    with temporary_folder() as folder:
        recording = Path(folder, 'log.mcap')
        _convert(path, recording)
        reader = RecordingReader(path, recording.open('rb', buffering=0))
    reader.library = 'a data logger, as CSV'
    return reader


def _convert(path: Path, recording: Path) -> None:
    """Write a data log as a recording, on the brick's clock and with the document's values."""
    packets = read_csv_log(path)
    if not packets:
        raise RecordingError(f'{path}: a data log without packets')
    first = packets[0]
    with RecordingWriter(recording) as writer:
        messages = BrickMessages(
            lambda topic: writer.sender(topic.resolved(), topic.type_name), LogFormat()
        )
        messages.begin(first.time_ms * MILLISECOND_NS, f'1 {path.stem}')
        for each in packets:
            time_ms = first.time_ms + elapsed(first, each)
            messages.packet(time_ms * MILLISECOND_NS, each)
