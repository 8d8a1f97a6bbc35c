"""Writing MCAP recordings that rosbag2, Foxglove, PlotJuggler, mcap and rosbags can read."""

from __future__ import annotations

import fcntl
import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np
from mcap.records import Channel, Schema
from mcap.well_known import MessageEncoding, Profile, SchemaEncoding
from numpy.typing import NDArray

from ballbot_ros.errors import RecordingError, os_errors
from ballbot_ros.recording.mcap_writer import McapWriter, MessageBlock
from ballbot_ros.recording.rosbag2 import (
    DERIVED,
    METADATA_NAME,
    OUTCOME_KEYS,
    RELIABLE_LATCHED,
    QosProfile,
    RecordedTopic,
    TimeRange,
    media_type,
    offered_qos_profiles,
    parse_offered_qos,
    serialized_metadata,
)
from ballbot_ros.recording.schemas import schema

INCOMPLETE = 'incomplete'
"""Name of the metadata record with the ``reason`` why a recording is incomplete."""

RUN_OUTCOME = 'ballbot_run'
"""Name of the metadata record with the outcome of the run, as reported by its plant."""

RUN_PARTICIPANTS = 'ballbot_participants'
"""Name of the metadata record that describes the participants of the run, by role."""

_TYPE_HASH = 'topic_type_hash'
"""Key of a channel's metadata, with the hash of its type."""

RecordedMessages = tuple[RecordedTopic, NDArray[np.int64], NDArray[np.void]]
"""A topic, stamps [ns] that are in range and never decrease, and its messages as structures."""


def is_locked(file: int) -> bool:
    """Return whether a :class:`RecordingWriter` of any process is writing an open file."""
    try:
        fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except OSError as error:
        return isinstance(error, BlockingIOError)
    fcntl.flock(file, fcntl.LOCK_UN)
    return False


class RecordingWriter:
    """A new MCAP file, for use by one thread.

    Every method raises `RecordingError` if the file can't be written, and every method except
    `close` if the recording is closed; the constructor raises it if the file already exists. A
    failed write closes the recording; the file is then cut off, and readable up to its last
    complete chunk. A chunk ends at `chunk_size`, uncompressed [byte].
    """

    def __init__(self, path: str | os.PathLike[str], *, chunk_size: int = 2**20) -> None:
        self.path = Path(path)
        with os_errors(RecordingError, self.path, 'file'):
            self._stream = self.path.open('xb')
        with suppress(OSError):  # Some network file systems do not support locks.
            fcntl.flock(self._stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
        self._open = True
        self._schemas: dict[tuple[str, str, bytes], int] = {}
        self._topics: dict[int, RecordedTopic] = {}
        self._added: set[tuple[str, bool]] = set()
        with self._writing():
            self._writer = McapWriter(self._stream, Profile.ROS2, 'ballbot_ros', chunk_size)
            self._writer.flush()

    @classmethod
    def with_attachments(cls, path: Path, folder: str) -> RecordingWriter:
        """Create a file, and its folder, with the files of a folder attached; '' for none.

        It raises RecordingError if a file or folder can't be read or written.
        """
        with os_errors(RecordingError, folder):
            files = sorted(Path(folder).iterdir()) if folder else []
            attachments = {each.name: each.read_bytes() for each in files}
        with os_errors(RecordingError, path):
            path.parent.mkdir(parents=True, exist_ok=True)
        writer = cls(path)
        for name, data in attachments.items():
            writer.add_attachment(name, media_type(name), data)
        return writer

    def __enter__(self) -> RecordingWriter:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def add_topic(
        self,
        name: str,
        type_name: str,
        *,
        qos: Sequence[QosProfile] = (RELIABLE_LATCHED,),
        type_hash: str | None = None,
        derived: bool = False,
    ) -> RecordedTopic:
        """Add a topic by its full name, and return it for `write`.

        Derived and published messages of one topic are in different channels. It raises
        RecordingError if the topic was already added, or its type is not that of ROS 2 Jazzy.

        Parameters
        ----------
        type_name : str
            Its type, such as ``sensor_msgs/msg/Imu``.
        qos : sequence of QosProfile
            QoS offered by each of its publishers.
        type_hash : str, optional
            Hash of the type in the graph; it must equal that of the definition in ROS 2 Jazzy.
        derived : bool
            Whether its messages are computed from other messages of the recording.
        """
        try:
            definition = schema(type_name)
        except RecordingError as error:
            raise RecordingError(f'{self.path}: topic {name}: {error}') from None
        if (name, derived) in self._added:
            raise RecordingError(f'{self.path}: topic {name} was already added')
        self._added.add((name, derived))
        type_hash = type_hash or definition.type_hash
        if definition.type_hash not in ('', type_hash):
            raise RecordingError(
                f'{self.path}: topic {name}: {type_name} has the hash {type_hash}, '
                f'in ROS 2 Jazzy {definition.type_hash}'
            )
        metadata = {
            'offered_qos_profiles': offered_qos_profiles(tuple(qos)),
            _TYPE_HASH: type_hash,
        }
        if derived:
            metadata[DERIVED] = 'true'
        key = (type_name, SchemaEncoding.ROS2, definition.text.encode())
        return self._register(name, MessageEncoding.CDR, key, metadata, qos)

    def sender(self, name: str, type_name: str, **settings: Any) -> Callable[..., None]:
        """Return a function of stamp, message and publish time that numbers and writes messages.

        Its first call adds the topic, with settings as in :meth:`add_topic`.
        """
        topic: RecordedTopic | None = None

        def send(stamp_ns: int, data: bytes, publish_ns: int | None = None) -> None:
            nonlocal topic
            topic = topic or self.add_topic(name, type_name, **settings)
            self.write(topic, stamp_ns, data, topic.count + 1, publish_ns)

        return send

    def copy_topic(self, channel: Channel, definition: Schema | None) -> RecordedTopic:
        """Add a topic of another recording unchanged, whatever its type, and return it for `write`.

        The definition is the channel's schema, if it has one.
        """
        key = (definition.name, definition.encoding, definition.data) if definition else None
        metadata = channel.metadata
        qos = parse_offered_qos(metadata.get('offered_qos_profiles', ''))
        return self._register(channel.topic, channel.message_encoding, key, metadata, qos)

    def _register(
        self,
        topic: str,
        encoding: str,
        definition: tuple[str, str, bytes] | None,
        metadata: dict[str, str],
        qos: Sequence[QosProfile],
    ) -> RecordedTopic:
        """Register a channel and its schema (name, encoding, text)."""
        with self._writing():
            if definition and definition not in self._schemas:
                self._schemas[definition] = self._writer.add_schema(*definition)
            schema_id = self._schemas[definition] if definition else 0
            number = self._writer.add_channel(topic, encoding, schema_id, metadata)
        type_name, type_hash = definition[0] if definition else '', metadata.get(_TYPE_HASH, '')
        self._topics[number] = RecordedTopic(number, topic, type_name, type_hash, qos)
        return self._topics[number]

    def write(
        self,
        topic: RecordedTopic,
        stamp_ns: int,
        data: bytes,
        sequence: int,
        publish_ns: int | None = None,
    ) -> None:
        """Record a message in CDR, with its encapsulation header, of a topic of this recording.

        It raises RecordingError if a number is out of range.

        Parameters
        ----------
        stamp_ns : int
            Log time, which is the sim time, 0 ... 2**63 - 1 [ns].
        sequence : int
            Sequence number of the publisher, 0 ... 2**32 - 1.
        publish_ns : int, optional
            Publish time [ns]; the log time by default.
        """
        if not self._open:
            raise self._closed()
        if not (0 <= stamp_ns < 2**63 and 0 <= sequence < 2**32):
            raise RecordingError(
                f'{self.path}: {topic.name}: the stamp {stamp_ns} ns or the sequence number '
                f'{sequence} is out of range'
            )
        try:
            publish_ns = stamp_ns if publish_ns is None else publish_ns
            self._writer.add_message(topic.channel, stamp_ns, data, publish_ns, sequence)
        except OSError as error:
            raise self._failure(error) from None
        topic.count += 1

    def write_all(self, messages: Iterable[RecordedMessages]) -> None:
        """Record messages as :meth:`write` does, in the order of their stamps.

        Those with the same stamp are in the order in which they are given. The sequence number of
        each is one more than that of the last one of its topic.
        """
        blocks = []
        for topic, stamps_ns, data in messages:
            sequences = topic.count + 1 + np.arange(len(data))
            topic.count += len(data)
            blocks.append(MessageBlock(topic.channel, sequences, stamps_ns, data))
        if blocks:
            with self._writing():
                self._writer.add_messages(blocks)

    def flush(self) -> None:
        """Pass all messages to the operating system, so that killing this process loses none."""
        with self._writing():
            self._writer.flush()

    def add_attachment(
        self, name: str, media_type: str, data: bytes, create_ns: int = 0, log_ns: int = 0
    ) -> None:
        """Attach a file, such as the scenario; its times [ns] are 0 if they mean nothing."""
        with self._writing():
            self._writer.add_attachment(create_ns, log_ns, name, media_type, data)

    def add_metadata(self, name: str, mapping: Mapping[str, str]) -> None:
        """Add a metadata record."""
        with self._writing():
            self._writer.add_metadata(name, dict(mapping))

    def add_outcome(self, outcome: Mapping[str, str]) -> None:
        """Record how the run ended; `outcome` has a value for each of `OUTCOME_KEYS`."""
        self.add_metadata(RUN_OUTCOME, {key: outcome[key] for key in OUTCOME_KEYS})

    def mark_incomplete(self, reason: str) -> None:
        """Mark the recording as incomplete, with the reason."""
        self.add_metadata(INCOMPLETE, {'reason': reason})

    def close(self) -> None:
        """Finish the file; no effect if it is closed or writing has failed.

        It raises RecordingError if it can't, or the file was moved or removed in the meantime.
        """
        if not self._open:
            return
        self.flush()
        name = os.fsencode(self.path.name).decode(errors='replace')
        times = TimeRange(*self._writer.times_ns) if self._writer.times_ns else None
        description = serialized_metadata(name, self._topics.values(), times)
        self.add_metadata(METADATA_NAME, {'serialized_metadata': description})
        with self._writing():
            self._writer.finish()
            is_in_place = self._is_in_place()
            self._stream.close()
        self._open = False
        if not is_in_place:
            raise RecordingError(f'{self.path}: moved or removed while being written')

    def _is_in_place(self) -> bool:
        try:
            found = self.path.stat()
        except (FileNotFoundError, NotADirectoryError):
            return False
        return os.path.samestat(found, os.fstat(self._stream.fileno()))

    @contextmanager
    def _writing(self) -> Iterator[None]:
        if not self._open:
            raise self._closed()
        try:
            yield
        except OSError as error:
            raise self._failure(error) from None

    def _closed(self) -> RecordingError:
        return RecordingError(f'{self.path}: the recording is closed')

    def _failure(self, error: OSError) -> RecordingError:
        self._open = False
        with suppress(OSError):
            self._stream.close()
        return RecordingError(f'{self.path}: {error.strerror}')
