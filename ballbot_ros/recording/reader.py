"""Reading MCAP recordings, also those whose recorder was killed."""

from __future__ import annotations

import os
import struct
import zlib
from collections.abc import Collection, Iterator
from io import BytesIO, FileIO
from pathlib import Path
from types import TracebackType
from typing import Any, NamedTuple

import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Chunk, Header, Metadata, Schema, Statistics
from mcap.stream_reader import get_chunk_data_stream
from mcap.well_known import MessageEncoding, Profile
from mcap.writer import MCAP0_MAGIC
from rosbags.interfaces import Msgdef
from rosbags.serde import SerdeError

from ballbot_ros.recording.container import INCOMPLETE
from ballbot_ros.recording.errors import RecordingError
from ballbot_ros.recording.schemas import schema, typestore

_head = struct.Struct('<BQ')
_message = struct.Struct('<HIQQ')

_DAMAGE = (McapError, struct.error, ValueError, OverflowError, MemoryError, zstandard.ZstdError)
"""What mcap and zstandard raise on bytes that are not what they should be."""


class TopicSummary(NamedTuple):
    """A topic's type, such as ``sensor_msgs/msg/Imu``, and number of messages."""

    type_name: str
    message_count: int


class AttachedFile(NamedTuple):
    """An attachment's media type and content."""

    media_type: str
    data: bytes


class RawMessage(NamedTuple):
    """A message as it was recorded: CDR with its encapsulation header; the stamp in ns."""

    topic: str
    stamp_ns: int
    sequence: int
    data: bytes


class _Record(NamedTuple):
    """A record's place: `offset` and `size` are of its fields, cut off by the file's end."""

    opcode: int
    offset: int
    size: int
    whole: bool


class RecordingReader:
    """A recording, read message by message in the order of the file.

    Attributes
    ----------
    path : Path
        The file.

    Raises
    ------
    RecordingError
        If the file cannot be read or is not an MCAP file of ROS 2.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.path = Path(path)
        self._damages: list[str] = []
        self._finished = False
        self._statistics: Statistics | None = None
        self._schemas: dict[int, str] = {}
        self._channels: dict[int, Channel] = {}
        self._counts: dict[int, int] = {}
        self._message_records: list[_Record] = []
        self._attachment_records: list[_Record] = []
        self._metadata: dict[str, dict[str, str]] = {}
        try:
            self._file = FileIO(self.path)
        except OSError as error:
            raise RecordingError(f'{self.path}: {error.strerror}') from None
        try:
            self._scan()
        except BaseException:
            self.close()
            raise

    def __enter__(self) -> RecordingReader:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.close()

    def __iter__(self) -> Iterator[tuple[str, int, Any]]:
        return self.messages()

    @property
    def damage(self) -> str | None:
        """What is missing: the file's end, or what the recorder has noted as missing.

        Known after opening, but for corrupt messages, which only reading them shows.
        """
        return '; '.join(self._damages) or None

    @property
    def complete(self) -> bool:
        """Whether nothing is known to be missing."""
        return not self._damages

    @property
    def count(self) -> int:
        """Number of messages."""
        return sum(topic.message_count for topic in self.topics().values())

    def topics(self) -> dict[str, TopicSummary]:
        """Return type and number of messages of each topic."""
        return {
            channel.topic: TopicSummary(
                self._schemas.get(channel.schema_id, ''), self._counts.get(number, 0)
            )
            for number, channel in self._channels.items()
        }

    def metadata(self) -> dict[str, dict[str, str]]:
        """Return the sets of keys and values by name; of equal names the last."""
        return self._metadata

    def attachments(self) -> dict[str, AttachedFile]:
        """Return the attached files by name; of equal names the last.

        Raises
        ------
        RecordingError
            If one of them is corrupt.
        """
        files = {}
        for record in self._attachment_records:
            fields = self._read(record)
            crc = int.from_bytes(fields[-4:], 'little')
            if crc and zlib.crc32(fields[:-4]) != crc:
                raise RecordingError(f'{self.path}: attachment at byte {record.offset} is corrupt')
            attachment = Attachment.read(_stream(fields))
            files[attachment.name] = AttachedFile(attachment.media_type, attachment.data)
        return files

    def messages(self, topics: Collection[str] | None = None) -> Iterator[tuple[str, int, Any]]:
        """Iterate over decoded messages.

        Parameters
        ----------
        topics : collection of str, optional
            Only these; all by default.

        Returns
        -------
        iterator of tuple
            Topic, stamp [ns], and the message as a rosbags object.

        Raises
        ------
        RecordingError
            If there is no such topic, its type is unknown, or a message is not of that type.
        """
        definitions = {
            topic: self._definition(topic)
            for topic in (self.topics() if topics is None else topics)
        }
        return self._decode(definitions)

    def raw_messages(self, topics: Collection[str] | None = None) -> Iterator[RawMessage]:
        """Iterate over messages as they were recorded.

        Parameters
        ----------
        topics : collection of str, optional
            Only these; all by default.

        Raises
        ------
        RecordingError
            If there is no such topic.
        """
        for topic in topics or ():
            self._channel(topic)
        return self._select(topics)

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def _channel(self, topic: str) -> Channel:
        for channel in self._channels.values():
            if channel.topic == topic:
                return channel
        names = ', '.join(sorted(self.topics())) or 'none'
        raise RecordingError(f'{self.path}: no topic {topic!r}, only {names}')

    def _definition(self, topic: str) -> Msgdef[object]:
        channel = self._channel(topic)
        if channel.message_encoding != MessageEncoding.CDR:
            raise RecordingError(
                f'{self.path}: topic {topic} is encoded as {channel.message_encoding!r}, '
                f'not as {MessageEncoding.CDR!r}'
            )
        type_name = self._schemas.get(channel.schema_id, '')
        try:
            schema(type_name)
        except RecordingError as error:
            raise RecordingError(f'{self.path}: topic {topic}: {error}') from None
        return typestore().get_msgdef(type_name)

    def _decode(self, definitions: dict[str, Msgdef[object]]) -> Iterator[tuple[str, int, Any]]:
        store = typestore()
        for topic, stamp_ns, _, data in self._select(definitions):
            definition = definitions[topic]
            try:
                decode = definition.deserialize_cdr_be, definition.deserialize_cdr_le
                message, _ = decode[data[1] & 1](data[4:], 0, definition.cls, store)
            except (IndexError, SerdeError, ValueError, struct.error) as error:
                raise RecordingError(
                    f'{self.path}: {topic} at {stamp_ns} ns is no {definition.name}: {error}'
                ) from None
            yield topic, stamp_ns, message

    def _select(self, topics: Collection[str] | None) -> Iterator[RawMessage]:
        names = {
            number: channel.topic
            for number, channel in self._channels.items()
            if topics is None or channel.topic in topics
        }
        for channel, sequence, stamp_ns, data in self._walk():
            if channel in names:
                yield RawMessage(names[channel], stamp_ns, sequence, bytes(data))

    def _walk(self) -> Iterator[tuple[int, int, int, memoryview]]:
        """Iterate over channel, sequence number, stamp and data of all messages."""
        for record in self._message_records:
            try:
                content = self._content(record)
                for opcode, start, end in _split(content):
                    if opcode == Opcode.MESSAGE:
                        channel, sequence, stamp_ns, _ = _message.unpack_from(content, start)
                        yield channel, sequence, stamp_ns, content[start + _message.size : end]
                    else:
                        self._define(opcode, content[start:end])
            except _DAMAGE:
                if record.whole:
                    self._report(f'corrupt at byte {record.offset}')
                return

    def _content(self, record: _Record) -> memoryview:
        """Return the records that a chunk, or a message outside of chunks, consists of."""
        fields = self._read(record)
        if record.opcode == Opcode.MESSAGE:
            return memoryview(_head.pack(record.opcode, len(fields)) + fields)
        chunk = Chunk.read(_stream(fields))
        if not record.whole:
            return memoryview(_salvage(chunk))
        stream, size = get_chunk_data_stream(chunk, validate_crc=True)
        return memoryview(stream.read(size))

    def _scan(self) -> None:
        """Find every record outside of chunks; count the messages if the summary does not."""
        magic = os.pread(self._file.fileno(), len(MCAP0_MAGIC), 0)
        if not magic:
            raise RecordingError(f'{self.path}: empty file')
        if magic != MCAP0_MAGIC:
            raise RecordingError(f'{self.path}: not an MCAP file')
        for record in self._records():
            try:
                self._note(record)
            except _DAMAGE:
                self._report(f'corrupt at byte {record.offset}')
                break
        statistics = self._statistics
        if (
            self._finished
            and statistics
            and statistics.channel_message_counts.keys() <= self._channels.keys()
        ):
            self._counts.update(statistics.channel_message_counts)
            chunks = sum(record.opcode == Opcode.CHUNK for record in self._message_records)
            if chunks != statistics.chunk_count:
                self._report(f'{chunks} chunks instead of {statistics.chunk_count}')
        else:
            for channel, *_ in self._walk():
                self._counts[channel] = self._counts.get(channel, 0) + 1

    def _records(self) -> Iterator[_Record]:
        """Iterate over the records outside of chunks."""
        size = os.fstat(self._file.fileno()).st_size
        position = len(MCAP0_MAGIC)
        while not self._finished:
            head = os.pread(self._file.fileno(), _head.size, position)
            if len(head) < _head.size or not head[0]:  # a machine that lost power leaves zeros
                break
            opcode, length = _head.unpack(head)
            position += _head.size
            whole = position + length <= size
            yield _Record(opcode, position, min(length, size - position), whole)
            if not whole:
                break
            position += length
        magic = os.pread(self._file.fileno(), len(MCAP0_MAGIC), position)
        self._finished = self._finished and magic == MCAP0_MAGIC
        if not self._finished:
            self._report(f'cut off at byte {size}')

    def _note(self, record: _Record) -> None:
        if not record.whole and record.opcode != Opcode.CHUNK:
            return
        if record.opcode in (Opcode.CHUNK, Opcode.MESSAGE):
            self._message_records.append(record)
        elif record.opcode == Opcode.HEADER:
            profile = Header.read(_stream(self._read(record))).profile
            if profile != Profile.ROS2:
                raise RecordingError(f'{self.path}: profile {profile!r} is not {Profile.ROS2!r}')
        elif record.opcode == Opcode.ATTACHMENT:
            self._attachment_records.append(record)
        elif record.opcode == Opcode.METADATA:
            metadata = Metadata.read(_stream(self._read(record)))
            self._metadata[metadata.name] = metadata.metadata
            if metadata.name == INCOMPLETE:
                self._report(metadata.metadata.get('reason', INCOMPLETE))
        elif record.opcode == Opcode.STATISTICS:
            self._statistics = Statistics.read(_stream(self._read(record)))
        elif record.opcode == Opcode.FOOTER:
            self._finished = True
        else:
            self._define(record.opcode, self._read(record))

    def _define(self, opcode: int, fields: bytes | memoryview) -> None:
        if opcode == Opcode.SCHEMA:
            definition = Schema.read(_stream(fields))
            self._schemas[definition.id] = definition.name
        elif opcode == Opcode.CHANNEL:
            channel = Channel.read(_stream(fields))
            self._channels[channel.id] = channel

    def _report(self, damage: str) -> None:
        if damage not in self._damages:
            self._damages.append(damage)

    def _read(self, record: _Record) -> bytes:
        try:
            return os.pread(self._file.fileno(), record.size, record.offset)
        except OSError as error:
            raise RecordingError(f'{self.path}: {error.strerror}') from None
        except ValueError:
            raise RecordingError(f'{self.path}: the recording is closed') from None


def _stream(fields: bytes | memoryview) -> ReadDataStream:
    return ReadDataStream(BytesIO(fields))


def _split(content: memoryview) -> Iterator[tuple[int, int, int]]:
    """Iterate over opcode, start and end of the whole records in `content`."""
    start = _head.size
    while start <= len(content):
        opcode, size = _head.unpack_from(content, start - _head.size)
        if start + size > len(content):
            return
        yield opcode, start, start + size
        start += size + _head.size


def _salvage(chunk: Chunk) -> bytes:
    """Decompress as much as there is of a chunk that was cut off."""
    if chunk.compression != 'zstd':
        return b''
    return zstandard.ZstdDecompressor().decompressobj().decompress(chunk.data)
