"""Finding the intact parts of a damaged MCAP file."""

from __future__ import annotations

import re
import struct
import zlib
from collections.abc import Iterator
from io import BytesIO
from mmap import ACCESS_READ, mmap
from pathlib import Path
from typing import Any, NamedTuple

from mcap import records
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.stream_reader import breakup_chunk
from mcap.writer import MCAP0_MAGIC

from ballbot_ros.recording.reader import DAMAGE, summary_holds

_RECORD_HEADER = struct.Struct('<BQ')
_CHUNK_HEADER = struct.Struct('<QQQII')
_LENGTH = struct.Struct('<Q')
_CRC = struct.Struct('<I')
_INDEX_HEADER = struct.Struct('<HI')
_FOOTER_SIZE = _RECORD_HEADER.size + 20

_POSSIBLE_HEADER = re.compile(rb'[\x01-\x0f].{5}\0\0\0', re.DOTALL)
"""An opcode and a length below one terabyte."""

_POSSIBLE_CHUNK = re.compile(rb'\x06.{5}\0\0\0', re.DOTALL)

_PARSERS: dict[int, Any] = {
    Opcode.HEADER: records.Header,
    Opcode.FOOTER: records.Footer,
    Opcode.SCHEMA: records.Schema,
    Opcode.CHANNEL: records.Channel,
    Opcode.MESSAGE: records.Message,
    Opcode.CHUNK_INDEX: records.ChunkIndex,
    Opcode.ATTACHMENT: records.Attachment,
    Opcode.ATTACHMENT_INDEX: records.AttachmentIndex,
    Opcode.STATISTICS: records.Statistics,
    Opcode.METADATA: records.Metadata,
    Opcode.METADATA_INDEX: records.MetadataIndex,
    Opcode.SUMMARY_OFFSET: records.SummaryOffset,
    Opcode.DATA_END: records.DataEnd,
}
_KNOWN = {*_PARSERS, Opcode.MESSAGE_INDEX}
_UNCHECKED = (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE)
"""Records without a checksum of their own.

In a file with chunks, the search after a damaged place does not accept them: they may be bytes of
a damaged chunk, whose checksum has failed.
"""


class Damage(NamedTuple):
    """A damaged part of the file.

    Attributes
    ----------
    start, end : int
        Where the damage starts, and where intact data follow [byte].
    newest_ns : int or None
        The newest stamp in the damaged part [ns]; None unless it is a chunk with a readable header.
    in_summary : bool
        Whether the damage is in the summary, after all messages.
    """

    start: int
    end: int
    newest_ns: int | None
    in_summary: bool


class _Chunk(NamedTuple):
    """Position of a chunk; its content is None if the checksum fails."""

    end: int
    newest_ns: int
    content: list[records.McapRecord] | None


class Salvage:
    """A file that may be cut off or corrupt anywhere after its first eight bytes.

    Chunks and attachments are accepted if their checksums match. After a damaged place, reading
    continues at the next consistent record.
    """

    def __init__(self, path: Path) -> None:
        self._file = path.open('rb')
        self._map = mmap(self._file.fileno(), 0, access=ACCESS_READ)
        self.size = len(self._map)
        self._chunked = any(
            self._chunk_at(found.start()) for found in _POSSIBLE_CHUNK.finditer(self._map)
        )

    def __enter__(self) -> Salvage:
        return self

    def __exit__(self, *error: object) -> None:
        self._map.close()
        self._file.close()

    def read(self) -> Iterator[tuple[int, records.McapRecord | Damage]]:
        """Iterate over the records, including those in chunks, and the damaged places.

        Yields
        ------
        tuple
            Position after the record or its chunk [byte], and the record or damage. The summary at
            the end of the file is included only if its checksum matches.
        """
        position = len(MCAP0_MAGIC)
        in_summary = False
        while position < self.size:
            found = self._record_at(position)
            if found is None:
                chunk = self._chunk_at(position)
                end = chunk.end if chunk else self._next_record(position + 1)
                if chunk and chunk.content is not None:
                    yield from ((end, record) for record in chunk.content)
                else:
                    newest = chunk.newest_ns if chunk else self._newest_of_cut_chunk(position)
                    yield end, Damage(position, end, newest, in_summary)
                    if end == self.size:
                        return
                position = end
                continue
            end, record = found
            if isinstance(record, records.Footer):
                return
            yield end, record
            position = end
            if isinstance(record, records.DataEnd):
                in_summary = True
                if not self._summary_holds():
                    break
        yield self.size, Damage(position, self.size, None, in_summary)

    def _record_at(self, position: int) -> tuple[int, records.McapRecord] | None:
        """Return end and content of the record at `position` if it is consistent."""
        if position + _RECORD_HEADER.size > self.size:
            return None
        opcode, length = _RECORD_HEADER.unpack_from(self._map, position)
        begin = position + _RECORD_HEADER.size
        end = begin + length
        if opcode not in _KNOWN or end > self.size:
            return None
        if opcode == Opcode.MESSAGE_INDEX:  # large, and not needed here
            channel, size = _INDEX_HEADER.unpack_from(self._map, begin) if length >= 6 else (0, 0)
            whole = length == _INDEX_HEADER.size + size
            return (end, records.MessageIndex(channel, [])) if whole else None
        content = self._map[begin:end]
        stream = ReadDataStream(BytesIO(content))
        try:
            if opcode == Opcode.MESSAGE:
                record = records.Message.read(stream, length)
            else:
                record = _PARSERS[opcode].read(stream)
        except DAMAGE:
            return None
        if stream.count != length:
            return None
        match record:
            case records.Attachment():
                whole = _CRC.unpack(content[-4:])[0] in (0, zlib.crc32(content[:-4]))
            case records.Metadata():
                whole = bool(record.name)
            case records.Message():
                # The data can be anything, so check the length: another record must follow.
                whole = self._may_begin_at(end)
            case records.Footer():
                whole = self._map[end:] == MCAP0_MAGIC
            case _:
                whole = True
        return (end, record) if whole else None

    def _may_begin_at(self, position: int) -> bool:
        if position == self.size:
            return True
        return _POSSIBLE_HEADER.match(self._map, position) is not None

    def _chunk_at(self, position: int) -> _Chunk | None:
        """Return the chunk at `position`.

        It is recognised by its checksum, or by two equal lengths, since its opcode or either length
        may be corrupt.
        """
        begin = position + _RECORD_HEADER.size
        if begin + _CHUNK_HEADER.size > self.size:
            return None
        opcode, length = _RECORD_HEADER.unpack_from(self._map, position)
        oldest, newest, size, crc, name_size = _CHUNK_HEADER.unpack_from(self._map, begin)
        name_at = begin + _CHUNK_HEADER.size
        name = self._map[name_at : name_at + min(name_size, 8)]
        data_at = name_at + name_size + _LENGTH.size
        if name not in (b'', b'zstd', b'lz4') or data_at > self.size:
            return None
        inner = data_at + _LENGTH.unpack_from(self._map, data_at - _LENGTH.size)[0]
        outer = begin + length
        for end in dict.fromkeys((inner, outer)):
            if not data_at <= end <= self.size or (crc == 0 and inner != outer):
                continue
            chunk = records.Chunk(
                compression=name.decode(),
                data=self._map[data_at:end],
                message_start_time=oldest,
                message_end_time=newest,
                uncompressed_crc=crc,
                uncompressed_size=size,
            )
            try:
                return _Chunk(end, newest, breakup_chunk(chunk, validate_crc=True))
            except DAMAGE:
                continue
        if opcode == Opcode.CHUNK and inner == outer <= self.size and self._may_begin_at(inner):
            return _Chunk(inner, newest, None)
        return None

    def _newest_of_cut_chunk(self, position: int) -> int | None:
        begin = position + _RECORD_HEADER.size
        if begin + _CHUNK_HEADER.size > self.size or self._map[position] != Opcode.CHUNK:
            return None
        return int(_CHUNK_HEADER.unpack_from(self._map, begin)[1])

    def _next_record(self, position: int) -> int:
        """Return the position of the next consistent record, or the end of the file."""
        while found := _POSSIBLE_HEADER.search(self._map, position):
            position = found.start()
            opcode = self._map[position]
            if opcode == Opcode.CHUNK:
                if self._chunk_at(position):
                    return position
            elif not (self._chunked and opcode in _UNCHECKED) and self._record_at(position):
                return position
            position += 1
        return self.size

    def data_holds(self, data_end: int) -> bool:
        """Return whether everything before the DataEnd record matches the checksum in it.

        Parameters
        ----------
        data_end : int
            Position after that record [byte].
        """
        (expected,) = _CRC.unpack_from(self._map, data_end - _CRC.size)
        with (
            memoryview(self._map) as whole,
            whole[: data_end - _RECORD_HEADER.size - _CRC.size] as data,
        ):
            return expected in (0, zlib.crc32(data))

    def next_recording(self, position: int) -> int | None:
        """Return the position after `position` where another recording is appended, if any."""
        joint = self._map.find(MCAP0_MAGIC * 2, position)
        return None if joint < 0 else joint + len(MCAP0_MAGIC)

    def _summary_holds(self) -> bool:
        footer_at = self.size - len(MCAP0_MAGIC) - _FOOTER_SIZE
        found = self._record_at(footer_at) if footer_at > 0 else None
        return (
            found is not None
            and isinstance(found[1], records.Footer)
            and summary_holds(self._map, found[1])
        )
