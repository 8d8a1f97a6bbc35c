"""Messages of a chunk of an MCAP file as arrays.

A loop over the messages themselves would take several times as long as reading the file.
"""

from __future__ import annotations

import struct
from array import array
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

import numpy as np
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from numpy.typing import NDArray
from rosbags.interfaces import Nodetype
from rosbags.typesys.store import Typestore

Rows = NDArray[np.intp]

_LENGTH = struct.Struct('<Q')
RECORD_HEADER_SIZE = 1 + _LENGTH.size
"""An opcode and the length of the content [byte]."""

_ROWS_AT_ONCE = 4096

MESSAGE_HEADER = np.dtype(
    [
        ('opcode', 'u1'),
        ('length', '<u8'),
        ('channel', '<u2'),
        ('sequence', '<u4'),
        ('log_ns', '<u8'),
        ('publish_ns', '<u8'),
    ]
)
_MAX_INT64_NS = 2**63 - 1
_SECOND_NS = 10**9
_STAMP = np.dtype([('encoding', 'u1', 4), ('sec', '<i4'), ('nanosec', '<u4')])
"""Begin of a message in CDR whose first field is a header or a time."""


class RawMessage(NamedTuple):
    """A message as recorded: CDR with its encapsulation header, stamp in ns."""

    topic: str
    stamp_ns: int
    sequence: int
    data: bytes


@dataclass(frozen=True)
class Batch:
    """Messages in the order of their file.

    Attributes
    ----------
    starts, ends : ndarray, shape (n,)
        Start and end of each message in `data`.
    names : mapping of int to str
        The topics by channel number.
    """

    data: bytes
    headers: NDArray[np.void]
    starts: Rows
    ends: Rows
    names: Mapping[int, str]

    @classmethod
    def of_records(cls, data: bytes, names: Mapping[int, str]) -> Batch:
        """Create a batch of the messages in MCAP records.

        It raises McapError if a record is incomplete, or the channel of a message is unknown.
        """
        bounds = np.array(record_bounds(data), np.intp)
        is_message = np.frombuffer(data, np.uint8)[bounds[:-1]] == Opcode.MESSAGE
        begins, ends = bounds[:-1][is_message], bounds[1:][is_message]
        starts = begins + MESSAGE_HEADER.itemsize
        if (starts > ends).any():
            raise McapError('a message is shorter than its header')
        headers = read_structs(data, begins, MESSAGE_HEADER)
        if unknown := set(np.unique(headers['channel']).tolist()) - names.keys():
            raise McapError(f'channel {min(unknown)} not found')
        return cls(data, headers, starts, ends, names)

    def __len__(self) -> int:
        """Return the number of messages."""
        return len(self.starts)

    @property
    def log_ns(self) -> NDArray[np.int64]:
        """The log times [ns], limited to the largest int64 (year 2262)."""
        return np.asarray(np.minimum(self.headers['log_ns'], _MAX_INT64_NS), np.int64)

    def stamps_ns(self, rows: Rows) -> NDArray[np.int64]:
        """Return the stamps [ns] of messages that begin with a header or a time."""
        begins = read_structs(self.data, self.starts[rows], _STAMP)
        is_big_endian = begins['encoding'][:, 1] % 2 == 0
        sec, nanosec = (
            np.where(is_big_endian, begins[name].byteswap(), begins[name])
            for name in ('sec', 'nanosec')
        )
        return np.asarray(sec.astype(np.int64) * _SECOND_NS + nanosec)

    def select(self, rows: Rows | NDArray[np.bool_]) -> Batch:
        """Return some of the messages, by row numbers or a mask."""
        return Batch(self.data, self.headers[rows], self.starts[rows], self.ends[rows], self.names)

    def rows(self) -> dict[str, Rows]:
        """Return the rows of each topic that has messages."""
        channels = self.headers['channel']
        found: dict[str, Rows] = {}
        for number in np.flatnonzero(np.bincount(channels)).tolist():
            rows, name = np.flatnonzero(channels == number), self.names[number]
            found[name] = np.union1d(found[name], rows) if name in found else rows
        return found

    def match_bytes(self, rows: Rows, offset: int, content: bytes) -> NDArray[np.bool_]:
        """Return which of the messages in `rows` have `content` at `offset` [byte], as a mask."""
        begins = self.starts[rows] + offset
        fits = begins + len(content) <= self.ends[rows]
        found = read_structs(self.data, np.where(fits, begins, 0), np.dtype(f'V{len(content)}'))
        alike = found.view(np.uint8).reshape(len(rows), -1) == np.frombuffer(content, np.uint8)
        return np.asarray(fits & alike.all(axis=1))

    def contents(self, rows: Rows) -> list[bytes]:
        """Return the content of messages."""
        spans = zip(self.starts[rows].tolist(), self.ends[rows].tolist(), strict=True)
        return [self.data[start:end] for start, end in spans]

    def message(self, row: int) -> RawMessage:
        """Return a message."""
        return next(self.select(np.array([row])).messages())

    def messages(self) -> Iterator[RawMessage]:
        """Iterate over the messages."""
        names = ('channel', 'log_ns', 'sequence')
        for first in range(0, len(self), _ROWS_AT_ONCE):
            rows = slice(first, first + _ROWS_AT_ONCE)
            columns = (self.headers[rows][name].tolist() for name in names)
            spans = zip(self.starts[rows].tolist(), self.ends[rows].tolist(), strict=True)
            for channel, log_ns, sequence, (start, end) in zip(*columns, spans, strict=True):
                yield RawMessage(self.names[channel], log_ns, sequence, self.data[start:end])


def record_bounds(data: bytes) -> array[int]:
    """Return where each MCAP record begins, and the last ends; McapError if one is incomplete."""
    bounds, offset = array('Q'), 0
    while offset < len(data):
        bounds.append(offset)
        (length,) = _LENGTH.unpack_from(data, offset + 1)
        offset += RECORD_HEADER_SIZE + length
    if offset != len(data):
        raise McapError('a record is longer than the chunk that holds it')
    bounds.append(offset)
    return bounds


def read_structs(data: bytes, offsets: Rows, dtype: np.dtype[Any]) -> NDArray[np.void]:
    """Return copies of the structures at `offsets` in `data`, which need not be aligned."""
    if not len(offsets):
        return np.empty(0, dtype)
    return _structs_in(data, dtype.itemsize)[offsets].view(dtype)


def write_structs(data: NDArray[np.uint8], offsets: Rows, structs: NDArray[np.void]) -> None:
    """Write structures at `offsets` in `data`, which need not be aligned."""
    if len(offsets):
        places = _structs_in(data, structs.itemsize)
        places[offsets] = structs.view(places.dtype)


def _structs_in(data: bytes | NDArray[np.uint8], size: int) -> NDArray[np.void]:
    """Return the structures of a size at every offset in `data`."""
    return np.ndarray((len(data) - size + 1,), f'V{size}', data, strides=(1,))


_HEADER_SIZE = 4
"""Size of the encapsulation header [byte]; alignment counts from its end."""

_NUMPY_NAMES = {'char': 'uint8'}


@dataclass(frozen=True)
class BatchLayout:
    """The form shared by all messages of a type with equal texts and sequence lengths.

    Attributes
    ----------
    dtype : numpy.dtype
        A structure as long as the message, with a field for each number, array or sequence of
        numbers, and nested message.
    offsets : ndarray, shape (k,)
        Positions of the bytes that determine the form: encoding, lengths and texts.
    fixed_bytes : ndarray, shape (k,)
        Required values of these bytes.
    """

    dtype: np.dtype[Any]
    offsets: Rows
    fixed_bytes: NDArray[np.uint8]

    @classmethod
    def of(cls, data: bytes, store: Typestore, type_name: str) -> BatchLayout:
        """Return the layout of a message, which must be valid for its type in `store`."""
        walk = _Walk(data, store)
        dtype = walk.message(type_name, 0)
        offsets = np.array(walk.fixed_offsets, np.intp)
        return cls(dtype, offsets, np.frombuffer(data, np.uint8)[offsets])

    def read(self, batch: Batch, rows: Rows) -> tuple[NDArray[np.bool_], NDArray[Any]]:
        """Return a mask of the messages in `rows` that have this form, and their numbers.

        The numbers are a record array with the field names of the type.
        """
        fits = (batch.ends - batch.starts)[rows] == self.dtype.itemsize
        records = read_structs(batch.data, batch.starts[rows[fits]], self.dtype)
        content = records.view(np.uint8).reshape(-1, self.dtype.itemsize)
        alike = (content[:, self.offsets] == self.fixed_bytes).all(axis=1)
        if not alike.all():
            fits[fits], records = alike, records[alike]
        return fits, records.view(np.recarray)


class _Walk:
    """Parses a message once and notes everything that determines its form."""

    def __init__(self, data: bytes, store: Typestore) -> None:
        self._data, self._store = data, store
        self._order: Literal['<', '>'] = '<' if data[1] else '>'
        self._offset = _HEADER_SIZE
        self.fixed_offsets = list(range(_HEADER_SIZE))

    def message(self, type_name: str, begin: int) -> np.dtype[Any]:
        """Return the structure of a message, from its begin to the end of the data.

        It has the fields at this offset, except texts and lists of messages.
        """
        _, descriptions = self._store.fielddefs[type_name]
        items = [(name, self._item(description)) for name, description in descriptions]
        fields = [(name, *item) for name, item in items if item]
        return np.dtype({
            'names': [name for name, _, _ in fields],
            'formats': [dtype for _, _, dtype in fields],
            'offsets': [offset - begin for _, offset, _ in fields],
            'itemsize': len(self._data) - begin,
        })  # fmt: skip

    def _item(self, description: Any) -> tuple[int, np.dtype[Any]] | None:
        """Return the position of a field [byte] and its type, unless it is left out."""
        node, detail = description
        if node == Nodetype.NAME:
            return self._offset, self.message(detail, self._offset)
        if node == Nodetype.BASE:
            if detail[0] == 'string':
                self._text()
                return None
            return self._numbers(detail[0], ())
        element, count = detail
        if node == Nodetype.SEQUENCE:
            count = self._length()
        if element[0] == Nodetype.BASE and element[1][0] != 'string':
            return self._numbers(element[1][0], (count,))
        for _ in range(count):
            self._item(element)
        return None

    def _numbers(self, name: str, shape: tuple[int, ...]) -> tuple[int, np.dtype[Any]]:
        dtype = np.dtype(_NUMPY_NAMES.get(name, name)).newbyteorder(self._order)
        whole = np.dtype((dtype, shape))
        if whole.itemsize:
            self._offset += -(self._offset - _HEADER_SIZE) % dtype.itemsize
        offset = self._offset
        self._offset += whole.itemsize
        return offset, whole

    def _text(self) -> None:
        length = self._length()
        self.fixed_offsets += range(self._offset, self._offset + length)
        self._offset += length

    def _length(self) -> int:
        offset, dtype = self._numbers('uint32', ())
        self.fixed_offsets += range(offset, self._offset)
        return int(np.frombuffer(self._data, dtype, 1, offset)[0])
