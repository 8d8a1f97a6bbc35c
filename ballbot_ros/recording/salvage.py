"""Finding the intact parts of a damaged MCAP file."""

from __future__ import annotations

import re
import struct
import zlib
from collections.abc import Iterable, Iterator
from itertools import chain
from mmap import ACCESS_READ, mmap
from pathlib import Path
from typing import NamedTuple

from mcap import records
from mcap.writer import MCAP0_MAGIC

from ballbot_ros.recording.mcap_records import MESSAGE, LimitedReader, LimitError
from ballbot_ros.recording.reader import DAMAGE, summary_holds

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
                holds = record.channel_id in self._channels and self._may_begin_at(end)
            case _:
                holds = True
        return (end, record, parts) if holds and used == length else None

    def _may_begin_at(self, position: int) -> bool:
        return position == self.size or bool(_POSSIBLE_HEADER.match(self._map, position))

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
