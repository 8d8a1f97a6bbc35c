"""Recovery of damaged recordings."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ballbot_ros.errors import RecordingError
from ballbot_ros.process import ProgressCallback
from ballbot_ros.recording.reader import RecordingReader
from ballbot_ros.recording.rosbag2 import METADATA_NAME
from ballbot_ros.recording.writer import RecordingWriter


@dataclass
class Repair:
    """Result of a repair: how many messages are kept, and where the file is damaged, on one line.

    `output` is None if no repair was needed.
    """

    output: Path | None
    message_count: int
    description: str


def repair(
    path: Path, output: Path | None = None, progress: ProgressCallback = lambda done, total: None
) -> Repair:
    """Copy a damaged recording, up to the damage, to a new one.

    By default, `output` is next to `path`, with ``_repaired`` in its name. `progress` is called
    with the number of messages done and their total. It raises RecordingError if the file is not a
    recording of ROS 2, can't be read or is still being written, or if `output` already exists or
    can't be written.
    """
    path = Path(path)
    output = Path(output) if output else path.with_name(f'{path.stem}_repaired{path.suffix}')
    with RecordingReader(path) as reader:
        if reader.being_written:
            raise RecordingError(
                f'{path}: still being recorded; repair it when its recorder has ended'
            )
        batches = [(len(batch), int(batch.log_ns.max())) for batch in reader.batches()]
        count = sum(size for size, _ in batches)
        if not reader.corruption:
            return Repair(None, count, f'no repair needed, {count} messages intact')
        description = f'{reader.corruption}; {count} messages'
        if count:
            description += f' up to {max(last_ns for _, last_ns in batches) * 1e-9:.3f} s'
        description += ' kept'
        writer = RecordingWriter(output)
        try:
            with writer:
                _copy(reader, writer, count, progress)
                writer.mark_incomplete(f'repaired: {description}')
        except BaseException:
            output.unlink(missing_ok=True)
            raise
    return Repair(output, count, description)


def _copy(
    reader: RecordingReader, writer: RecordingWriter, count: int, progress: ProgressCallback
) -> None:
    topics = {
        channel.id: writer.copy_topic(channel, definition)
        for channel, definition in reader.channels()
    }
    done = 0
    for batch in reader.batches():
        contents = batch.contents(np.arange(len(batch)))
        for header, data in zip(batch.headers, contents, strict=True):
            writer.write(
                topics[int(header['channel'])],
                int(header['log_ns']),
                data,
                int(header['sequence']),
                int(header['publish_ns']),
            )
        done += len(batch)
        progress(done, count)
    for name, (media_type, data) in reader.attachments().items():
        writer.add_attachment(name, media_type, data)
    for name, mapping in reader.metadata().items():
        if name != METADATA_NAME:
            writer.add_metadata(name, mapping)
