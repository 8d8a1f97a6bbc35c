"""The MCAP container around the messages: a file that only grows, and its ending."""

from __future__ import annotations

import os
import struct
import zlib
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from io import FileIO

from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    AttachmentIndex,
    Channel,
    ChunkIndex,
    DataEnd,
    Footer,
    McapRecord,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)
from mcap.writer import MCAP0_MAGIC

from ballbot_ros.recording.rosbag2 import TimeRange

INCOMPLETE = 'incomplete'
"""Name of the metadata record that says why a recording lacks something, under ``reason``."""

_footer_head = struct.Struct('<BQQQ').pack
_FOOTER_SIZE = 20


def encode(record: McapRecord) -> bytes:
    """Return the bytes of `record`, with its opcode and length."""
    builder = RecordBuilder()
    record.write(builder)
    data: bytes = builder.end()  # type: ignore[no-untyped-call]
    return data


class GrowingFile:
    """A new file whose every write is whole or does not happen.

    Attributes
    ----------
    end : int
        Its size [byte].
    crc : int
        CRC-32 of its content.

    Raises
    ------
    OSError
        If the file exists or cannot be created.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self._file = FileIO(path, 'x')
        self.end = 0
        self.crc = 0

    def append(self, data: bytes | bytearray) -> None:
        """Hand `data` to the operating system.

        Raises
        ------
        OSError
            If it does not take all of it; the file is then as it was.
        """
        rest = memoryview(data)
        try:
            while rest:
                position = self.end + len(data) - len(rest)
                rest = rest[os.pwrite(self._file.fileno(), rest, position) :]
        except OSError:
            with suppress(OSError):
                self._file.truncate(self.end)
            raise
        self.end += len(data)
        self.crc = zlib.crc32(data, self.crc)

    def close(self) -> None:
        """Close the file."""
        self._file.close()


@dataclass
class Summary:
    """What stands behind the data: definitions, statistics and indexes."""

    schemas: list[Schema] = field(default_factory=list)
    channels: list[Channel] = field(default_factory=list)
    chunks: list[ChunkIndex] = field(default_factory=list)
    attachments: list[AttachmentIndex] = field(default_factory=list)
    metadata: list[MetadataIndex] = field(default_factory=list)

    def times(self) -> TimeRange | None:
        """Return the stamps of the oldest and the newest message, None if there is none."""
        if not self.chunks:
            return None
        return TimeRange(
            min(chunk.message_start_time for chunk in self.chunks),
            max(chunk.message_end_time for chunk in self.chunks),
        )

    def ending(self, counts: dict[int, int], end: int, crc: int) -> bytes:
        """Return all that follows the data of a file.

        Parameters
        ----------
        counts : dict of int
            Number of messages by channel.
        end, crc : int
            Size and CRC-32 of the file so far.
        """
        data_end = encode(DataEnd(crc))
        start = end + len(data_end)
        summary = b''
        offsets: list[SummaryOffset] = []
        for opcode, records in self._groups(counts):
            group = b''.join(map(encode, records))
            if group:
                offsets.append(SummaryOffset(opcode, start + len(summary), len(group)))
                summary += group
        offset_start = start + len(summary)
        summary += b''.join(map(encode, offsets))
        footer_head = _footer_head(Opcode.FOOTER, _FOOTER_SIZE, start, offset_start)
        footer = Footer(start, offset_start, zlib.crc32(footer_head, zlib.crc32(summary)))
        return data_end + summary + encode(footer) + MCAP0_MAGIC

    def _groups(self, counts: dict[int, int]) -> list[tuple[Opcode, Sequence[McapRecord]]]:
        start, end = self.times() or (0, 0)
        statistics = Statistics(
            message_count=sum(counts.values()),
            schema_count=len(self.schemas),
            channel_count=len(self.channels),
            attachment_count=len(self.attachments),
            metadata_count=len(self.metadata),
            chunk_count=len(self.chunks),
            message_start_time=start,
            message_end_time=end,
            channel_message_counts=counts,
        )
        return [
            (Opcode.SCHEMA, self.schemas),
            (Opcode.CHANNEL, self.channels),
            (Opcode.STATISTICS, [statistics]),
            (Opcode.CHUNK_INDEX, self.chunks),
            (Opcode.ATTACHMENT_INDEX, self.attachments),
            (Opcode.METADATA_INDEX, self.metadata),
        ]
