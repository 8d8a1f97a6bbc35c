"""Writing an MCAP recording that rosbag2, Foxglove, PlotJuggler, mcap and rosbags read."""

from __future__ import annotations

import os
import struct
import zlib
from collections.abc import Mapping, Sequence
from contextlib import closing, suppress
from pathlib import Path
from types import TracebackType

import numpy as np
from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    AttachmentIndex,
    Channel,
    Chunk,
    ChunkIndex,
    Header,
    Metadata,
    MetadataIndex,
    Schema,
)
from mcap.well_known import MessageEncoding, Profile, SchemaEncoding
from mcap.writer import MCAP0_MAGIC
from zstandard import ZstdCompressor

from ballbot_ros.recording.container import INCOMPLETE, GrowingFile, Summary, encode
from ballbot_ros.recording.errors import RecordingError
from ballbot_ros.recording.qos import RELIABLE_LATCHED, QosProfile
from ballbot_ros.recording.rosbag2 import (
    METADATA_NAME,
    offered_qos_profiles,
    serialized_metadata,
)
from ballbot_ros.recording.schemas import schema

CHUNK_SIZE = 2**20
"""A chunk is closed when it holds more than this [byte]."""

_message_head = struct.Struct('<BQHIQQ').pack
_index_head = struct.Struct('<BQHI').pack
_index_entry = struct.Struct('<QQ').pack

_MESSAGE_OPCODE = int(Opcode.MESSAGE)
_MESSAGE_FIELDS_SIZE = 22
_INDEX_FIELDS_SIZE = 6
_INDEX_ENTRY_SIZE = 16


class Topic:
    """A topic of a recording: what `RecordingWriter.write` takes.

    Attributes
    ----------
    channel : int
        The MCAP channel's number.
    name, type_name, type_hash : str
        As given to `RecordingWriter.add_topic`.
    qos : sequence of QosProfile
        What the publishers offer.
    count : int
        Messages in the finished chunks.
    index : bytearray
        Stamp and place of each message in the chunk being filled.
    """

    __slots__ = ('channel', 'count', 'index', 'name', 'qos', 'type_hash', 'type_name')

    def __init__(
        self, channel: int, name: str, type_name: str, type_hash: str, qos: Sequence[QosProfile]
    ) -> None:
        self.channel = channel
        self.name = name
        self.type_name = type_name
        self.type_hash = type_hash
        self.qos = qos
        self.count = 0
        self.index = bytearray()


class RecordingWriter:
    """A new MCAP file.

    Once writing fails, the recording is finished as well as the disk allows, says that it is
    incomplete, and takes no more. For one thread.

    Parameters
    ----------
    path : path-like
        The file to create.
    chunk_size : int
        Size at which a chunk of messages is compressed and written [byte].

    Raises
    ------
    RecordingError
        If the file exists already or cannot be created.
    """

    def __init__(self, path: str | os.PathLike[str], *, chunk_size: int = CHUNK_SIZE) -> None:
        self.path = Path(path)
        self._chunk_size = chunk_size
        try:
            self._file = GrowingFile(path)
        except FileExistsError:
            raise RecordingError(f'{self.path}: already exists') from None
        except OSError as error:
            raise RecordingError(f'{self.path}: {error.strerror}') from None
        self._open = True
        self._compress = ZstdCompressor().compress
        self._chunk = bytearray()
        self._topics: dict[str, Topic] = {}
        self._schemas: dict[str, Schema] = {}
        self._summary = Summary()
        self._append(MCAP0_MAGIC + encode(Header(profile=Profile.ROS2, library='ballbot_ros')))

    def __enter__(self) -> RecordingWriter:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.close()

    def add_topic(
        self,
        name: str,
        type_name: str,
        *,
        qos: Sequence[QosProfile] = (RELIABLE_LATCHED,),
        type_hash: str | None = None,
    ) -> Topic:
        """Announce a topic.

        Parameters
        ----------
        name : str
            The topic's full name.
        type_name : str
            Its type, such as ``sensor_msgs/msg/Imu``.
        qos : sequence of QosProfile
            What each of its publishers offers.
        type_hash : str, optional
            The type's hash as the graph tells it; it must be that of the recorded definition.

        Returns
        -------
        Topic
            What `write` wants to know of it.

        Raises
        ------
        RecordingError
            If the topic is there already, or its type is not the one of ROS 2 Jazzy.
        """
        self._check_open()
        try:
            definition = schema(type_name)
        except RecordingError as error:
            raise RecordingError(f'{self.path}: topic {name}: {error}') from None
        if name in self._topics:
            raise RecordingError(f'{self.path}: topic {name} is recorded already')
        type_hash = type_hash or definition.type_hash
        if definition.type_hash not in ('', type_hash):
            raise RecordingError(
                f'{self.path}: topic {name}: {type_name} has the hash {type_hash}, '
                f'in ROS 2 Jazzy {definition.type_hash}'
            )
        if type_name not in self._schemas:
            self._schemas[type_name] = Schema(
                id=len(self._schemas) + 1,
                name=type_name,
                encoding=SchemaEncoding.ROS2,
                data=definition.text.encode(),
            )
            self._summary.schemas.append(self._schemas[type_name])
            self._chunk += encode(self._schemas[type_name])
        channel = Channel(
            id=len(self._topics) + 1,
            topic=name,
            message_encoding=MessageEncoding.CDR,
            schema_id=self._schemas[type_name].id,
            metadata={
                'offered_qos_profiles': offered_qos_profiles(qos),
                'topic_type_hash': type_hash,
            },
        )
        self._summary.channels.append(channel)
        self._chunk += encode(channel)
        topic = Topic(channel.id, name, type_name, type_hash, qos)
        self._topics[name] = topic
        return topic

    def write(self, topic: Topic, stamp_ns: int, data: bytes, sequence: int) -> None:
        """Record a message.

        Parameters
        ----------
        topic : Topic
            From `add_topic` of this recording.
        stamp_ns : int
            Sim time, becomes log time and publish time [ns].
        data : bytes
            The message in CDR with its encapsulation header.
        sequence : int
            The publisher's number of this message, 0 ... 2**32 - 1.

        Raises
        ------
        RecordingError
            If the recording is closed or cannot be written.
        """
        if not self._open:
            self._check_open()
        chunk = self._chunk
        offset = len(chunk)
        size = _MESSAGE_FIELDS_SIZE + len(data)
        head = _message_head(_MESSAGE_OPCODE, size, topic.channel, sequence, stamp_ns, stamp_ns)
        chunk += head + data
        topic.index += _index_entry(stamp_ns, offset)
        if offset > self._chunk_size:
            self.flush()

    def flush(self) -> None:
        """Hand everything to the operating system: killing this process loses none of it.

        Raises
        ------
        RecordingError
            If the recording is closed or cannot be written.
        """
        self._check_open()
        topics = [topic for topic in self._topics.values() if topic.index]
        if topics:
            self._end_chunk(topics)
        else:
            self._append(self._chunk)
        self._chunk.clear()

    def add_attachment(self, name: str, media_type: str, data: bytes) -> None:
        """Attach a file, such as the scenario.

        Raises
        ------
        RecordingError
            If the recording is closed or cannot be written.
        """
        self._check_open()
        attachment = Attachment(
            create_time=0, log_time=0, name=name, media_type=media_type, data=data
        )
        record = encode(attachment)
        index = AttachmentIndex(
            offset=self._file.end,
            length=len(record),
            create_time=0,
            log_time=0,
            data_size=len(data),
            name=name,
            media_type=media_type,
        )
        self._append(record)
        self._summary.attachments.append(index)

    def add_metadata(self, name: str, mapping: Mapping[str, str]) -> None:
        """Add a named set of keys and values.

        Raises
        ------
        RecordingError
            If the recording is closed or cannot be written.
        """
        self._check_open()
        try:
            self._add_metadata(name, mapping)
        except OSError as error:
            raise self._failure(error) from None

    def mark_incomplete(self, reason: str) -> None:
        """Say in the recording that it lacks something.

        Raises
        ------
        RecordingError
            If the recording is closed or cannot be written.
        """
        self.add_metadata(INCOMPLETE, {'reason': reason})

    def close(self) -> None:
        """Finish the file; closing it again does nothing.

        Raises
        ------
        RecordingError
            If the rest cannot be written.
        """
        if not self._open:
            return
        self.flush()
        self._open = False
        try:
            with closing(self._file):
                self._finish()
        except OSError as error:
            raise RecordingError(f'{self.path}: {error.strerror}') from None

    def _check_open(self) -> None:
        if not self._open:
            raise RecordingError(f'{self.path}: the recording is closed')

    def _end_chunk(self, topics: Sequence[Topic]) -> None:
        stamps = np.frombuffer(b''.join(topic.index for topic in topics), '<u8')[::2]
        chunk = Chunk(
            compression='zstd',
            data=self._compress(self._chunk),
            message_start_time=int(stamps.min()),
            message_end_time=int(stamps.max()),
            uncompressed_crc=zlib.crc32(self._chunk),
            uncompressed_size=len(self._chunk),
        )
        records = bytearray(encode(chunk))
        index = ChunkIndex(
            chunk_start_offset=self._file.end,
            chunk_length=len(records),
            message_start_time=chunk.message_start_time,
            message_end_time=chunk.message_end_time,
            message_index_offsets={},
            message_index_length=0,
            compression=chunk.compression,
            compressed_size=len(chunk.data),
            uncompressed_size=chunk.uncompressed_size,
        )
        for topic in topics:
            index.message_index_offsets[topic.channel] = self._file.end + len(records)
            size = len(topic.index)
            records += _index_head(
                Opcode.MESSAGE_INDEX, _INDEX_FIELDS_SIZE + size, topic.channel, size
            )
            records += topic.index
        index.message_index_length = len(records) - index.chunk_length
        self._append(records)
        self._summary.chunks.append(index)
        for topic in topics:
            topic.count += len(topic.index) // _INDEX_ENTRY_SIZE
            topic.index.clear()

    def _append(self, records: bytes | bytearray) -> None:
        try:
            self._file.append(records)
        except OSError as error:
            raise self._failure(error) from None

    def _add_metadata(self, name: str, mapping: Mapping[str, str]) -> None:
        record = encode(Metadata(name=name, metadata=dict(mapping)))
        index = MetadataIndex(offset=self._file.end, length=len(record), name=name)
        self._file.append(record)
        self._summary.metadata.append(index)

    def _failure(self, error: OSError) -> RecordingError:
        """Finish with what is on disk: what did not fit may have left enough room for that."""
        self._open = False
        with suppress(OSError), closing(self._file):
            self._add_metadata(INCOMPLETE, {'reason': str(error.strerror)})
            self._finish()
        return RecordingError(f'{self.path}: {error.strerror}')

    def _finish(self) -> None:
        name = os.fsencode(self.path.name).decode(errors='replace')
        description = serialized_metadata(name, self._topics.values(), self._summary.times())
        self._add_metadata(METADATA_NAME, {'serialized_metadata': description})
        counts = {topic.channel: topic.count for topic in self._topics.values() if topic.count}
        self._file.append(self._summary.ending(counts, self._file.end, self._file.crc))
