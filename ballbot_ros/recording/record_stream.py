"""The records of an MCAP file in file order."""

from __future__ import annotations

from mcap.opcode import Opcode
from mcap.records import McapRecord
from mcap.stream_reader import StreamReader


class RecordStream(StreamReader):
    """Reads all records except the message indexes.

    A file has an index for each topic and chunk, with an entry for each message. To parse them
    takes twice as long as everything else together.
    """

    def _read_record(self, opcode: int, length: int) -> McapRecord | None:
        if opcode == Opcode.MESSAGE_INDEX:
            self._stream.read(length)
            return None
        return super()._read_record(opcode, length)
