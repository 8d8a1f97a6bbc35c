"""Recovery of damaged recordings."""

from __future__ import annotations

import re
import struct
import zlib
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from itertools import chain
from mmap import ACCESS_READ, mmap
from pathlib import Path
from typing import NamedTuple

from mcap import records
from mcap.writer import MCAP0_MAGIC

from ballbot_ros.errors import RecordingError
from ballbot_ros.process import ProgressCallback
from ballbot_ros.recording.mcap_records import MESSAGE, LimitedReader, LimitError
from ballbot_ros.recording.overview import TopicOverview
from ballbot_ros.recording.reader import DAMAGE, RecordingReader, summary_holds
from ballbot_ros.recording.rosbag2 import METADATA_NAME, RecordedTopic
from ballbot_ros.recording.writer import RecordingWriter

_RECORD_HEADER = struct.Struct('<BQ')
_CRC = struct.Struct('<I')
_FOOTER_SIZE = _RECORD_HEADER.size + 20

_POSSIBLE_HEADER = re.compile(rb'[\x01-\x0f].{5}\0\0\0', re.DOTALL)
"""An opcode and a length below one terabyte."""

_LANDMARK = re.compile(rb'(?=[\x06\x09\x0c].{5}\0\0\0|\x89MCAP0\r\n)', re.DOTALL)
"""The possible header of a chunk, an attachment or a metadata record, or the end of a recording."""


class Damage(NamedTuple):
    """A damaged part of the file: where it starts, where intact data follow [byte], and why.

    The reason is empty unless the part exceeds a limit.
    """

    start: int
    end: int
    reason: str = ''


class Salvage:
    """A file that may be cut off or corrupt anywhere after its first eight bytes.

    Attributes
    ----------
    size : int
        [byte]
    is_cut_off : bool
        Whether the end of the file is missing.
    """

    def __init__(self, path: Path) -> None:
        with path.open('rb') as file:
            self._map = mmap(file.fileno(), 0, access=ACCESS_READ)
        self.size = self._data_end = len(self._map)
        self._channels: set[int] = set()
        self._reader, self._refusal = LimitedReader(self._map), ''
        self._summary: list[records.McapRecord] = []
        self._read_summary()
        self.is_cut_off = self._data_end == self.size and self._map[-8:] != MCAP0_MAGIC

    def __enter__(self) -> Salvage:
        return self

    def __exit__(self, *error: object) -> None:
        self._map.close()

    def read(self) -> Iterator[tuple[int, records.McapRecord | Damage]]:
        """Iterate over the records, including those in chunks, and the damaged parts.

        Reading resumes behind a damaged part where a checksum proves a chunk or an attachment, or
        at a metadata record, which has no checksum.

        Yields
        ------
        tuple
            Position after the record or its chunk [byte], and the record or damage. The records of
            the summary come first, and only if its checksum is right.
        """
        self._reader = LimitedReader(self._map)
        summary = ((len(MCAP0_MAGIC), record) for record in self._summary)
        for place, record in chain(summary, self._walk()):
            if isinstance(record, records.Channel):
                self._channels.add(record.id)
            yield place, record

    def _walk(self) -> Iterator[tuple[int, records.McapRecord | Damage]]:
        """Iterate over the data, up to the summary if that holds."""
        position = len(MCAP0_MAGIC)
        while position < self._data_end:
            found = self._record_at(position)
            if found is None:
                reason = self._refusal
                end = self._resume(position)
                yield end, Damage(position, end, reason)
                if end == self.size:
                    return
                position = end
                continue
            position, record, parts = found
            yield from ((position, part) for part in parts)
            if isinstance(record, records.DataEnd):
                break
        if self._data_end == self.size:
            yield self.size, Damage(position, self.size)

    def _record_at(
        self, position: int, *, proven: bool = False
    ) -> tuple[int, records.McapRecord, Iterable[records.McapRecord]] | None:
        """Return end, record and content at `position`; None if it is not consistent.

        With `proven` a chunk or an attachment needs a checksum.
        """
        self._refusal = ''
        begin = position + _RECORD_HEADER.size
        if begin > self.size:
            return None
        opcode, length = _RECORD_HEADER.unpack_from(self._map, position)
        end = begin + length
        try:
            if proven:  # many that are none could have the length of the file
                self._reader.take(min(length, self.size))
            content = self._map[begin:end]
            record, used = self._reader.parse(opcode, content)
            if record is None:
                return None
            parts: Iterable[records.McapRecord] = [record]
            if isinstance(record, records.Chunk):
                unpacked = self._reader.unpack(record)
                for part in self._reader.parse_all(unpacked):  # all are valid before one is used
                    self._reader.take(MESSAGE * isinstance(part, records.Message))
                parts = self._reader.parse_all(unpacked)
        except DAMAGE as error:
            if isinstance(error, LimitError):
                self._refusal = str(error)
            return None
        match record:
            case records.Chunk():
                holds = record.uncompressed_crc != 0 or not proven
            case records.Attachment():
                (crc,) = _CRC.unpack(content[-_CRC.size :])
                holds = crc == zlib.crc32(content[: -_CRC.size]) or (crc == 0 and not proven)
            case records.Metadata():
                holds = bool(record.name)
            case records.Message():
                # The data can be anything, so check the length: another record must follow.
                is_followed = end == self.size or _POSSIBLE_HEADER.match(self._map, end)
                holds = record.channel_id in self._channels and bool(is_followed)
            case _:
                holds = True
        return (end, record, parts) if holds and used == length else None

    def _resume(self, position: int) -> int:
        """Return where reading resumes: at a proven record, or at the end of the data."""
        for found in _LANDMARK.finditer(self._map, position):
            place = found.start()
            if self._map[place] == MCAP0_MAGIC[0]:
                break  # Another recording may follow, with other topics.
            if self._record_at(place, proven=True):
                return place
        return self._data_end

    def _read_summary(self) -> None:
        footer_at = max(0, self.size - len(MCAP0_MAGIC) - _FOOTER_SIZE)
        match self._record_at(footer_at):
            case _, records.Footer() as footer, _ if summary_holds(self._map, footer):
                position = self._data_end = footer.summary_start or footer_at
                while position < footer_at and (found := self._record_at(position)):
                    position, record, _ = found
                    if isinstance(record, records.Schema | records.Channel | records.Statistics):
                        self._summary.append(record)


@dataclass
class Repair:
    """Result of a repair.

    Attributes
    ----------
    output : Path or None
        The repaired recording; None if no repair was needed.
    message_count : int
        Number of messages kept.
    description : str
        Where the file is damaged, what is kept and what is lost, on one line.
    """

    output: Path | None
    message_count: int
    description: str


def repair(
    path: Path, output: Path | None = None, progress: ProgressCallback = lambda done, total: None
) -> Repair:
    """Copy the intact part of a damaged recording to a new one.

    Parameters
    ----------
    output : Path, optional
        The file to create; by default next to `path` with ``_repaired`` in its name.
    progress : callable, optional
        Called with the number of bytes done and their total.

    Raises
    ------
    RecordingError
        If the file is not a recording of ROS 2, can't be read or is still being written, or if
        `output` already exists or can't be written.
    """
    path = Path(path)
    output = Path(output) if output else path.with_name(f'{path.stem}_repaired{path.suffix}')
    with RecordingReader(path) as reader:
        if reader.being_written:
            raise RecordingError(
                f'{path}: still being recorded; repair it when its recorder has ended'
            )
        corruption = reader.corruption
    with Salvage(path) as salvage:
        survey = _Survey(salvage, lambda done: progress(done, 2 * salvage.size))
        count = survey.before.count + survey.behind.count
        if not corruption and not survey.damage:
            return Repair(None, count, f'no repair needed, {count} messages intact')
        description = survey.describe(salvage, corruption)
        writer = RecordingWriter(output)
        try:
            with writer:
                _copy(salvage, writer, lambda done: progress(salvage.size + done, 2 * salvage.size))
                writer.mark_incomplete(f'repaired: {description}')
        except BaseException:
            output.unlink(missing_ok=True)
            raise
    return Repair(output, count, description)


def _copy(salvage: Salvage, writer: RecordingWriter, progress: Callable[[int], None]) -> None:
    schemas: dict[int, records.Schema] = {}
    topics: dict[int, RecordedTopic] = {}
    for place, record in salvage.read():
        match record:
            case records.Schema():
                schemas[record.id] = record
            case records.Channel(id=number) if number not in topics:
                topics[number] = writer.copy_topic(record, schemas.get(record.schema_id))
            case records.Message(channel_id=number) if number in topics:
                writer.write(
                    topics[number],
                    record.log_time,
                    record.data,
                    record.sequence,
                    record.publish_time,
                )
            case records.Attachment():
                writer.add_attachment(
                    record.name, record.media_type, record.data, record.create_time, record.log_time
                )
            case records.Metadata(name=name) if name != METADATA_NAME:
                writer.add_metadata(name, record.metadata)
        progress(place)


class _Survey:
    """A first pass over the file: the damaged parts, and the messages before and behind the first.

    Without its channel, a message has no topic and is left out.
    """

    def __init__(self, salvage: Salvage, progress: Callable[[int], None]) -> None:
        self.damage: list[Damage] = []
        self.before, self.behind = TopicOverview(''), TopicOverview('')
        self._without_topic = 0
        self._total = 0
        channels: set[int] = set()
        for place, record in salvage.read():
            match record:
                case Damage():
                    self.damage.append(record)
                case records.Channel():
                    channels.add(record.id)
                case records.Message(channel_id=number) if number not in channels:
                    self._without_topic += 1
                case records.Message():
                    (self.behind if self.damage else self.before).add(record.log_time)
                case records.Statistics():
                    self._total = record.message_count
            progress(place)

    def describe(self, salvage: Salvage, corruption: str | None) -> str:
        """Return where the file is damaged, what is kept and what is lost."""
        kept = f'{self.before.count} messages'
        if self.before.last_ns is not None:
            kept += f' up to {self.before.last_ns * 1e-9:.3f} s'
        if self.behind.first_ns is not None:
            kept += f' and {self.behind.count} from {self.behind.first_ns * 1e-9:.3f} s on'
        parts = [self._places(salvage, corruption), f'{kept} kept']
        if self._without_topic:
            parts.append(f'{self._without_topic} left out, because their topic is lost')
        if self._total:
            lost = self._total - self.before.count - self.behind.count
            parts.append(f'{lost or "none"} lost')
        return '; '.join(parts)

    def _places(self, salvage: Salvage, corruption: str | None) -> str:
        if not self.damage:
            return f'{corruption}, in a part without a checksum'
        places = []
        corrupt = self.damage[:-1] if salvage.is_cut_off else self.damage
        if corrupt:
            which = f' (the first of {len(corrupt)} places)' if len(corrupt) > 1 else ''
            why = f' ({corrupt[0].reason})' if corrupt[0].reason else ''
            places.append(f'corrupt from byte {corrupt[0].start} to {corrupt[0].end}{why}{which}')
        if salvage.is_cut_off:
            places.append(f'cut off at byte {salvage.size}')
        left_out = sum(damage.end - damage.start for damage in self.damage)
        return f'{", ".join(places)}: {left_out} bytes left out'
