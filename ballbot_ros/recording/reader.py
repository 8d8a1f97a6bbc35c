"""Reading MCAP recordings, also those whose recorder was killed."""

from __future__ import annotations

import os
import struct
from collections import Counter
from collections.abc import Callable, Collection, Iterator
from io import FileIO
from mmap import ACCESS_READ, ALLOCATIONGRANULARITY, MADV_DONTNEED, mmap
from pathlib import Path
from typing import IO, Any, NamedTuple, TypeVar, cast

from mcap.exceptions import McapError
from mcap.reader import NonSeekingReader
from mcap.records import Attachment, Channel, Header, Message, Metadata, Schema, Statistics
from mcap.stream_reader import StreamReader
from mcap.well_known import Profile
from mcap.writer import MCAP0_MAGIC
from rosbags.serde import SerdeError
from zstandard import ZstdError

from ballbot_ros.recording.errors import RecordingError
from ballbot_ros.recording.schemas import schema, typestore
from ballbot_ros.recording.writer import INCOMPLETE

_DAMAGE = (McapError, struct.error, ValueError, OverflowError, RuntimeError, MemoryError, ZstdError)
"""What mcap, lz4 and zstandard raise on bytes that are not what they should be."""

_Item = TypeVar('_Item')

_LET_GO = 64 * ALLOCATIONGRANULARITY
"""Bytes read after which their memory is given back, so that a large file does not fill it."""


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


class RecordingReader:
    """A recording, read message by message in the order of the file.

    Of a file that is cut off or corrupt, what stands before the damage is read.

    Parameters
    ----------
    path : path-like
        The file.

    Raises
    ------
    RecordingError
        If the file cannot be read or is not an MCAP file of ROS 2.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.path = Path(path)
        self._broken = ''
        self._schemas: dict[int, str] = {}
        self._channels: dict[int, Channel] = {}
        self._attachments: dict[str, AttachedFile] = {}
        self._metadata: dict[str, dict[str, str]] = {}
        try:
            self._file = FileIO(self.path)
            magic = self._file.read(len(MCAP0_MAGIC))
        except OSError as error:
            raise RecordingError(f'{self.path}: {error.strerror}') from None
        try:
            if magic != MCAP0_MAGIC:
                raise RecordingError(f'{self.path}: {"not an MCAP" if magic else "empty"} file')
            if not self._scan(unpack=False):
                self._scan(unpack=True)
            self._types = {name: topic.type_name for name, topic in self.topics().items()}
        except BaseException:
            self.close()
            raise

    def __enter__(self) -> RecordingReader:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    @property
    def damage(self) -> str | None:
        """What is missing: the file's end, or what the recorder has noted as missing."""
        return '; '.join(filter(None, [*self._gaps, self._broken])) or None

    @property
    def complete(self) -> bool:
        """Whether nothing is known to be missing."""
        return self.damage is None

    @property
    def count(self) -> int:
        """Number of messages."""
        return self._counts.total()

    def topics(self) -> dict[str, TopicSummary]:
        """Return type and number of messages of each topic."""
        return {
            channel.topic: TopicSummary(
                self._schemas.get(channel.schema_id, ''), self._counts[channel.id]
            )
            for channel in self._channels.values()
        }

    def metadata(self) -> dict[str, dict[str, str]]:
        """Return the sets of keys and values by name; of equal names the last."""
        return self._metadata

    def attachments(self) -> dict[str, AttachedFile]:
        """Return the attached files by name; of equal names the last."""
        return self._attachments

    def messages(self, topics: Collection[str] | None = None) -> Iterator[tuple[str, int, Any]]:
        """Iterate over the messages of `topics`, or all, decoded.

        Yields
        ------
        tuple
            Topic, stamp [ns], and the message as a rosbags object.

        Raises
        ------
        RecordingError
            If there is no such topic, its type is unknown, or a message is not of that type.
        """
        for raw in self.raw_messages(topics):
            yield raw.topic, raw.stamp_ns, self.decode(raw)

    def decode(self, raw: RawMessage) -> Any:
        """Return a message of this recording as a rosbags object.

        Raises
        ------
        RecordingError
            If its type is unknown, or it is not of that type.
        """
        type_name = self._types.get(raw.topic, '')
        try:
            schema(type_name)
            return typestore().deserialize_cdr(raw.data, type_name)
        except (RecordingError, SerdeError) as error:
            raise RecordingError(
                f'{self.path}: {raw.topic} at {raw.stamp_ns} ns is no {type_name}: {error}'
            ) from None

    def raw_messages(self, topics: Collection[str] | None = None) -> Iterator[RawMessage]:
        """Iterate over the messages of `topics`, or all, as they were recorded.

        Raises
        ------
        RecordingError
            If there is no such topic.
        """
        known = self.topics().keys()
        for topic in topics or ():
            if topic not in known:
                names = ', '.join(sorted(known)) or 'none'
                raise RecordingError(f'{self.path}: no topic {topic!r}, only {names}')
        for _, channel, message in self._read(
            lambda stream: NonSeekingReader(stream, validate_crcs=True).iter_messages(
                topics, log_time_order=False
            )
        ):
            yield RawMessage(channel.topic, message.log_time, message.sequence, message.data)

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def _scan(self, *, unpack: bool) -> bool:
        """Note what the file holds; return whether that tells the number of messages."""
        self._counts: Counter[int] = Counter()
        self._gaps: list[str] = []
        statistics = None
        for record in self._read(
            lambda stream: StreamReader(stream, emit_chunks=not unpack, validate_crcs=True).records
        ):
            match record:
                case Message():
                    self._counts[record.channel_id] += 1
                case Schema():
                    self._schemas[record.id] = record.name
                case Channel():
                    self._channels[record.id] = record
                case Attachment():
                    self._attachments[record.name] = AttachedFile(record.media_type, record.data)
                case Metadata():
                    self._metadata[record.name] = record.metadata
                    if record.name == INCOMPLETE:
                        self._gaps.append(record.metadata.get('reason', INCOMPLETE))
                case Header(profile=profile) if profile != Profile.ROS2:
                    raise RecordingError(f"{self.path}: profile {profile!r} is not 'ros2'")
                case Statistics():
                    statistics = record
        if statistics and statistics.channel_message_counts.keys() <= self._channels.keys():
            self._counts = Counter(statistics.channel_message_counts)
            return True
        return False

    def _read(self, parse: Callable[[IO[bytes]], Iterator[_Item]]) -> Iterator[_Item]:
        """Iterate over what `parse` finds in the file, until its end or damage."""
        try:
            # Each map has a position of its own, so that iterators can take turns.
            stream = mmap(self._file.fileno(), 0, access=ACCESS_READ)
        except ValueError:
            raise RecordingError(f'{self.path}: the recording is closed') from None
        with stream:
            kept = 0
            try:
                for item in parse(cast('IO[bytes]', stream)):
                    yield item
                    if stream.tell() - kept >= _LET_GO:
                        stream.madvise(MADV_DONTNEED, kept, _LET_GO)
                        kept += _LET_GO
            except _DAMAGE:
                end = stream.tell()
                kind = 'cut off at' if end == len(stream) else 'corrupt before'
                self._broken = f'{kind} byte {end}'
