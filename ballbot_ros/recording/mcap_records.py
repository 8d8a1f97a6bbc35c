"""The records of MCAP files, read within limits: a file may come from anyone."""

from __future__ import annotations

import zlib
from collections import Counter
from collections.abc import Iterator
from io import BytesIO
from itertools import pairwise
from mmap import mmap
from typing import IO, cast

import lz4.frame
import zstandard
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Chunk, McapRecord, MessageIndex
from mcap.stream_reader import StreamReader

from ballbot_ros.recording.batch import RECORD_HEADER_SIZE, record_bounds

MAX_CHUNK = 2**25
"""Largest content of a chunk [byte]. Recorders begin a new one after about 1 MB, and the largest
message of this package, a map of 40 m, has 16 MB."""

MAX_RATIO, ALLOWANCE = 64, 2**26
"""Largest content of all chunks and messages: per byte of the file, and in addition [byte]. In
recordings of this package, chunks have 6 to 16 times the bytes of the file."""

MAX_DESCRIPTION, MAX_DESCRIPTIONS = 2**20, 2**21
"""Largest record that describes others, such as a schema, and largest sum of all different ones of
a kind [byte]. Parsed, they take up to 14 times as much memory."""

ENTRY = 2**10
"""What each description counts in addition, and each attachment [byte]: commands keep more."""

MESSAGE = 1700
"""What each message counts in addition [byte]: commands keep columns of them. Recordings of this
package have one message in 41 bytes."""

RECORD = 2**14
"""What each other record of the file counts in addition [byte]: there are about two per chunk."""

_LARGE = (Opcode.CHUNK, Opcode.MESSAGE, Opcode.ATTACHMENT)
_KEPT = (Opcode.HEADER, Opcode.SCHEMA, Opcode.CHANNEL, Opcode.METADATA, Opcode.ATTACHMENT)


class LimitError(McapError):
    """A record that is larger than allowed, or than it declares."""


class LimitedReader(StreamReader):
    """Reads the records of a file in one pass, within limits, and checks the checksums."""

    def __init__(self, stream: mmap) -> None:
        super().__init__(cast('IO[bytes]', stream), emit_chunks=True, validate_crcs=True)
        self._content_left = ALLOWANCE + MAX_RATIO * len(stream)
        self._kept: Counter[int] = Counter()
        self._known: set[int] = set()

    def _read_record(self, opcode: int, length: int) -> McapRecord | None:
        if opcode not in (Opcode.MESSAGE, Opcode.MESSAGE_INDEX):
            self.take(RECORD)
        return self.parse(opcode, self._stream.read(length))[0]

    def parse(self, opcode: int, content: bytes) -> tuple[McapRecord | None, int]:
        """Return a record, None if its kind is unknown, and the number of bytes it has used.

        A message index, which nothing here uses, is returned empty: parsing it would take longer
        than all other reading.
        """
        size = len(content)
        if opcode == Opcode.MESSAGE_INDEX:
            return MessageIndex(0, []), 6 + int.from_bytes(content[2:6], 'little')
        if size > MAX_DESCRIPTION and opcode <= Opcode.DATA_END and opcode not in _LARGE:
            raise LimitError(f'a description of {size} bytes, more than {MAX_DESCRIPTION}')
        reader = StreamReader(BytesIO(content))
        record = reader._read_record(opcode, size)
        if opcode in _KEPT and (key := hash(content)) not in self._known:
            cost = ENTRY + (size if opcode not in _LARGE else 0)
            if self._kept[opcode] + cost > MAX_DESCRIPTIONS:
                kind = Opcode(opcode).name.lower()
                raise LimitError(f'{kind} records of more than {MAX_DESCRIPTIONS} bytes')
            self._kept[opcode] += cost
            self._known.add(key)
        return record, reader._stream.count

    def take(self, size: int) -> None:
        """Count bytes to look at; raise LimitError if they are too many for the file."""
        self._content_left -= size
        if self._content_left < 0:
            raise LimitError(f'content for more than {MAX_RATIO} times the bytes of the file')

    def unpack(self, chunk: Chunk) -> bytes:
        """Return the records in a chunk; raises the errors of mcap, lz4 and zstandard."""
        size, data = chunk.uncompressed_size, chunk.data
        if size > MAX_CHUNK:
            raise LimitError(f'a chunk of {size} bytes, more than {MAX_CHUNK}')
        self.take(size)
        if chunk.compression == 'lz4':
            data = lz4.frame.LZ4FrameDecompressor().decompress(data, size + 1)
        elif chunk.compression == 'zstd':
            data = zstandard.ZstdDecompressor().stream_reader(data).read(size + 1)
        if len(data) > size:
            raise LimitError('a chunk larger than it declares')
        if len(data) < size or chunk.uncompressed_crc not in (0, zlib.crc32(data)):
            raise McapError('a chunk fails its checksum')
        return data

    def parse_all(self, content: bytes) -> Iterator[McapRecord]:
        """Iterate over the schemas, channels and messages in the content of a chunk."""
        for start, end in pairwise(record_bounds(content)):
            if content[start] in (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE):
                record, _ = self.parse(content[start], content[start + RECORD_HEADER_SIZE : end])
                if record:
                    yield record
