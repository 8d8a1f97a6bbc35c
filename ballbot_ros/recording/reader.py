"""Reading MCAP recordings, including those of a killed recorder."""

from __future__ import annotations

import os
import struct
import zlib
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator
from io import FileIO
from itertools import chain
from mmap import ACCESS_READ, ALLOCATIONGRANULARITY, MADV_DONTNEED, mmap
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import numpy as np
from mcap.data_stream import RecordBuilder
from mcap.exceptions import McapError
from mcap.records import (
    Attachment,
    Channel,
    Chunk,
    Footer,
    Header,
    McapRecord,
    Message,
    Metadata,
    Schema,
    Statistics,
)
from mcap.well_known import MessageEncoding, Profile
from mcap.writer import MCAP0_MAGIC
from rosbags.serde import SerdeError
from rosbags.typesys.store import Typestore
from zstandard import ZstdError

from ballbot_ros.errors import RecordingError, did_you_mean, os_errors, printable
from ballbot_ros.files import open_regular
from ballbot_ros.recording.batch import Batch, BatchLayout, RawMessage, Rows
from ballbot_ros.recording.mcap_records import MESSAGE, LimitedReader, LimitError
from ballbot_ros.recording.rosbag2 import DERIVED, QosProfile, TimeRange, parse_offered_qos
from ballbot_ros.recording.schemas import recorded_typestore
from ballbot_ros.recording.writer import INCOMPLETE, is_locked

DAMAGE = (McapError, struct.error, ValueError, OverflowError, RuntimeError, MemoryError, ZstdError)
"""Errors of mcap, lz4 and zstandard for corrupt bytes."""

_CRC_SIZE = 4
_FOOTER_SIZE = 25
"""Size of the part of the footer that its checksum covers [byte]."""

_NO_SCHEMA = Schema(id=0, data=b'', encoding='', name='')
_Item = TypeVar('_Item')

_LOOSE = 2**18
"""Size from which messages outside chunks are a batch [byte]."""

_LET_GO = 64 * ALLOCATIONGRANULARITY
"""Number of bytes to read before their memory is released."""


class TopicSummary(NamedTuple):
    """A topic's type, such as ``sensor_msgs/msg/Imu``, and its number of messages."""

    type_name: str
    message_count: int


class AttachedFile(NamedTuple):
    """An attachment's media type and content."""

    media_type: str
    data: bytes


def summary_holds(data: mmap, footer: Footer) -> bool:
    """Return whether the summary of a complete file matches the checksum in its footer."""
    if not footer.summary_crc:
        return True
    end = len(data) - len(MCAP0_MAGIC) - _CRC_SIZE
    # In a file without a summary, the checksum only covers the footer.
    start = footer.summary_start or end - _FOOTER_SIZE
    return zlib.crc32(data[start:end]) == footer.summary_crc


def is_finished(path: Path) -> bool:
    """Return whether a recording is there and has its end, so that nobody was killed writing it."""
    try:
        with open_regular(path) as file:
            end = file.seek(-len(MCAP0_MAGIC), os.SEEK_END)
            return end > 0 and file.read() == MCAP0_MAGIC
    except OSError:
        return False


class RecordingReader:
    """A recording, read message by message in file order.

    If the file is cut off or corrupt, the part before the damage is read. A space replaces each
    control character in the names of topics, types and attachments. It raises RecordingError if the
    file can't be read or is not an MCAP file of ROS 2.

    Parameters
    ----------
    converted : FileIO or None
        A file of another format, converted to MCAP. It is closed with the reader.

    Attributes
    ----------
    library : str
        Program that wrote the file, according to the file.
    times : TimeRange or None
        The oldest and the newest stamp [ns]; None if there are no messages.
    corruption : str or None
        Where the file is cut off or corrupt, as far as it has been read.
    """

    def __init__(self, path: str | os.PathLike[str], converted: FileIO | None = None) -> None:
        self.path = Path(path)
        self.library = ''
        self.times: TimeRange | None = None
        self.corruption: str | None = None
        self._schemas: dict[int, Schema] = {}
        self._channels: dict[int, Channel] = {}
        self._attachments: dict[str, AttachedFile] = {}
        self._metadata: dict[str, dict[str, str]] = {}
        with os_errors(RecordingError, self.path):
            self._given = open_regular(self.path)
            self._file = converted or self._given
            magic = self._file.read(len(MCAP0_MAGIC))
        try:
            if magic != MCAP0_MAGIC:
                raise RecordingError(f'{self.path}: {"not an MCAP" if magic else "empty"} file')
            if not self._scan(unpack=False):
                self._scan(unpack=True)
            self._types = {
                channel.topic: self._schema(channel) for channel in self._channels.values()
            }
            self._typestores: dict[str, Typestore] = {}
            self._layouts: dict[str, BatchLayout] = {}
        except BaseException:
            self.close()
            raise

    def __enter__(self) -> RecordingReader:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    @property
    def damage(self) -> str | None:
        """What is missing: the end of the file, or what the recorder noted as missing."""
        return '; '.join(filter(None, [*self._gaps, self.corruption])) or None

    @property
    def complete(self) -> bool:
        """Whether nothing is known to be missing."""
        return self.damage is None

    @property
    def size(self) -> int:
        """Size of the file [byte]."""
        return os.fstat(self._given.fileno()).st_size

    @property
    def being_written(self) -> bool:
        """Whether a recorder of this package is still writing the file."""
        return is_locked(self._given.fileno())

    @property
    def count(self) -> int:
        """Number of messages."""
        return self._counts.total()

    def topics(self) -> dict[str, TopicSummary]:
        """Return type and number of messages of each topic."""
        summaries: dict[str, TopicSummary] = {}
        for channel in self._channels.values():
            before = summaries.get(channel.topic)
            count = self._counts[channel.id] + (before.message_count if before else 0)
            summaries[channel.topic] = TopicSummary(self._schema(channel).name, count)
        return summaries

    def channels(self) -> list[tuple[Channel, Schema | None]]:
        """Return the channels, and their schemas if they have one."""
        return [(each, self._schemas.get(each.schema_id)) for each in self._channels.values()]

    def derived(self) -> set[str]:
        """Return the topics whose messages were all computed when the file was written."""
        published = {
            channel.topic for channel in self._channels.values() if DERIVED not in channel.metadata
        }
        return self.topics().keys() - published

    def offered_qos(self) -> dict[str, list[QosProfile]]:
        """Return the QoS offered by each topic's publishers; empty if unknown."""
        offers: dict[str, list[QosProfile]] = {}
        for channel in self._channels.values():
            found = parse_offered_qos(channel.metadata.get('offered_qos_profiles', ''))
            offers.setdefault(channel.topic, []).extend(found)
        return offers

    def metadata(self) -> dict[str, dict[str, str]]:
        """Return the last metadata record of each name."""
        return self._metadata

    def attachments(self) -> dict[str, AttachedFile]:
        """Return the last attached file of each name."""
        return self._attachments

    def unreadable(self) -> dict[str, str]:
        """Return the topics whose messages can't be decoded, and the reasons."""
        reasons: dict[str, str] = {}
        for channel in self._channels.values():
            definition = self._schema(channel)
            if channel.message_encoding != MessageEncoding.CDR:
                reasons[channel.topic] = f'its encoding is {channel.message_encoding!r}, not cdr'
                continue
            try:
                recorded_typestore(definition)
            except RecordingError as error:
                reasons[channel.topic] = str(error)
        return reasons

    def messages(self, topics: Collection[str] | None = None) -> Iterator[tuple[str, int, Any]]:
        """Iterate over the decoded messages of `topics`, or of all topics.

        Each has its topic, its stamp [ns], and its content as a rosbags object. It raises
        RecordingError if a topic is not in the file, its type is unknown, or a message does not
        match its type.
        """
        for raw in self.raw_messages(topics):
            yield raw.topic, raw.stamp_ns, self.decode(raw)

    def typestore(self, topic: str) -> Typestore:
        """Return the message types that decode a topic; RecordingError if its type is unknown."""
        store = self._typestores.get(topic)
        if store is None:
            store = self._typestores[topic] = recorded_typestore(self._types[topic])
        return store

    def decode(self, raw: RawMessage) -> Any:
        """Return a message of this recording as a rosbags object.

        It raises RecordingError if the type is unknown, or the message does not match it.
        """
        schema = self._types[raw.topic]
        try:
            return self.typestore(raw.topic).deserialize_cdr(raw.data, schema.name)
        except (RecordingError, SerdeError) as error:
            raise RecordingError(
                f'{self.path}: {raw.topic} at {raw.stamp_ns} ns is not a valid '
                f'{schema.name}: {error}'
            ) from None

    def raw_messages(
        self, topics: Collection[str] | None = None, start_ns: int = 0
    ) -> Iterator[RawMessage]:
        """Iterate over the messages of `topics`, or of all topics, from a stamp on, as recorded.

        It raises RecordingError if a topic is not in the file.
        """
        return chain.from_iterable(map(Batch.messages, self.batches(topics, start_ns)))

    def batches(self, topics: Collection[str] | None = None, start_ns: int = 0) -> Iterator[Batch]:
        """Iterate over the messages of :meth:`raw_messages`, with its error, a batch per chunk."""
        self.check_topics(topics or ())
        channels = {number: channel.topic for number, channel in self._channels.items()}
        wanted = [number for number, name in channels.items() if topics is None or name in topics]

        def parse(stream: mmap) -> Iterator[Batch]:
            reader = LimitedReader(stream)

            def select(group: Chunk | bytes) -> Batch:
                records = group if isinstance(group, bytes) else reader.unpack(group)
                batch = Batch.of_records(records, channels)
                reader.take(MESSAGE * len(batch))
                if start_ns:
                    batch = batch.select(batch.headers['log_ns'] >= start_ns)
                if topics is not None:
                    batch = batch.select(np.isin(batch.headers['channel'], wanted))
                return batch

            groups = (
                group
                for group in _grouped(reader.records)
                if isinstance(group, bytes) or group.message_end_time >= start_ns
            )
            # No name keeps a batch, which can be large, while the next one is unpacked.
            yield from filter(len, map(select, groups))

        return self._read(parse)

    def check_topics(self, topics: Iterable[str]) -> None:
        """Raise RecordingError for the first of `topics` that is not in the file."""
        known = self.topics().keys()
        for topic in topics:
            if topic not in known:
                names = ', '.join(sorted(known)) or 'none'
                hint = did_you_mean(topic, known)
                raise RecordingError(f'{self.path}: topic {topic!r} not found{hint}, only {names}')

    def records(self, topic: str, batch: Batch, rows: Rows) -> Iterator[tuple[Rows, Any]]:
        """Iterate over some messages of a topic in a batch, grouped by their form.

        A group has its rows, and its messages as a record array with the field names of the type,
        without texts and lists of messages. Its errors are those of :meth:`decode`.
        """
        while len(rows):
            layout = self._layouts.get(topic)
            if layout:
                fits, records = layout.read(batch, rows)
            if not layout or not fits[0]:
                first = batch.message(rows[0])
                self.decode(first)
                store, type_name = self.typestore(topic), self._types[topic].name
                layout = self._layouts[topic] = BatchLayout.of(first.data, store, type_name)
                fits, records = layout.read(batch, rows)
            yield rows[fits], records
            rows = rows[~fits]

    def close(self) -> None:
        """Close the file."""
        self._given.close()
        self._file.close()

    def contents(self) -> bytes:
        """Return the recording as the bytes of an MCAP file."""
        self._file.seek(0)
        return self._file.readall()

    def _schema(self, channel: Channel) -> Schema:
        return self._schemas.get(channel.schema_id, _NO_SCHEMA)

    def _scan(self, *, unpack: bool) -> bool:
        """Note the content of the file; return whether the number of messages is now known."""
        self._counts: Counter[int] = Counter()
        self._gaps: list[str] = []
        statistics = None
        oldest_ns, newest_ns = 2**64, -1

        def parse(stream: mmap) -> Iterator[McapRecord]:
            reader = LimitedReader(stream)
            for record in reader.records:
                if unpack and isinstance(record, Chunk):
                    for part in reader.parse_all(reader.unpack(record)):
                        reader.take(MESSAGE * isinstance(part, Message))
                        yield part
                if isinstance(record, Footer) and not summary_holds(stream, record):
                    raise McapError('the summary fails its checksum')
                yield record

        for record in self._read(parse):
            match record:
                case Message():
                    self._counts[record.channel_id] += 1
                    oldest_ns = min(oldest_ns, record.log_time)
                    newest_ns = max(newest_ns, record.log_time)
                case Schema():
                    record.name = printable(record.name)
                    self._schemas[record.id] = record
                case Channel():
                    record.topic = printable(record.topic)
                    self._channels[record.id] = record
                case Attachment():
                    file = AttachedFile(record.media_type, record.data)
                    self._attachments[printable(record.name)] = file
                case Metadata():
                    self._metadata[record.name] = record.metadata
                    if record.name == INCOMPLETE:
                        self._gaps.append(printable(record.metadata.get('reason', INCOMPLETE)))
                case Header():
                    if record.profile != Profile.ROS2:
                        raise RecordingError(
                            f"{self.path}: profile {record.profile!r} is not 'ros2'"
                        )
                    self.library = printable(record.library)
                case Statistics():
                    statistics = record
        if not unpack:
            known = statistics and statistics.channel_message_counts.keys() <= self._channels.keys()
            if self.corruption or not statistics or not known:
                return False
            self._counts = Counter(statistics.channel_message_counts)
            oldest_ns, newest_ns = statistics.message_start_time, statistics.message_end_time
        self.times = TimeRange(oldest_ns, newest_ns) if self.count else None
        return True

    def _read(self, parse: Callable[[mmap], Iterator[_Item]]) -> Iterator[_Item]:
        """Iterate over the results of `parse` on the file, until its end or damage."""
        try:
            # Map the file for each iterator: several can be active, each at its own position.
            stream = mmap(self._file.fileno(), 0, access=ACCESS_READ)
        except ValueError:
            raise RecordingError(f'{self.path}: the recording is closed') from None
        with stream:
            kept = 0
            try:
                for item in parse(stream):
                    yield item
                    del item  # it need not be kept while the next one is read
                    if read := (stream.tell() - kept) // _LET_GO * _LET_GO:
                        stream.madvise(MADV_DONTNEED, kept, read)
                        kept += read
            except LimitError as error:
                self.corruption = f'corrupt before byte {stream.tell()} ({error})'
            except DAMAGE:
                end = stream.tell()
                kind = 'cut off at' if end == len(stream) else 'corrupt before'
                self.corruption = f'{kind} byte {end}'


def _grouped(records: Iterable[McapRecord]) -> Iterator[Chunk | bytes]:
    """Iterate over the chunks of a file, and over the messages outside chunks as records."""
    loose = RecordBuilder()
    try:
        for record in records:
            if isinstance(record, Message):
                record.write(loose)
            if loose.count and (isinstance(record, Chunk) or loose.count > _LOOSE):
                yield bytes(loose.end())  # type: ignore[no-untyped-call]
            if isinstance(record, Chunk):
                yield record
    except DAMAGE:
        # Yield these messages before the error: the part before the damage is intact.
        yield bytes(loose.end())  # type: ignore[no-untyped-call]
        raise
    else:
        yield bytes(loose.end())  # type: ignore[no-untyped-call]
