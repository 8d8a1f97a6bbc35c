"""Positions of the numbers in CDR messages, for reading many messages at once."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from rosbags.interfaces import Nodetype
from rosbags.typesys.store import Typestore

from ballbot_ros.recording.batch import Batch, Rows, read_structs

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
        fields = walk.message(type_name)
        dtype = _structure(fields, 0, len(data))
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


@dataclass(frozen=True)
class _Field:
    """A field: its position in the message [byte], and its type or the fields of its message."""

    name: str
    offset: int
    content: Any


class _Walk:
    """Parses a message once and notes everything that determines its form."""

    def __init__(self, data: bytes, store: Typestore) -> None:
        self._data, self._store = data, store
        self._order: Literal['<', '>'] = '<' if data[1] else '>'
        self._offset = _HEADER_SIZE
        self.fixed_offsets = list(range(_HEADER_SIZE))

    def message(self, type_name: str) -> list[_Field]:
        """Return the fields of the message at this offset, except texts and lists of messages."""
        _, descriptions = self._store.fielddefs[type_name]
        fields = []
        for name, description in descriptions:
            item = self._item(description)
            if item is not None:
                fields.append(_Field(name, *item))
        return fields

    def _item(self, description: Any) -> tuple[int, Any] | None:
        node, detail = description
        if node == Nodetype.NAME:
            return self._offset, self.message(detail)
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

    def _numbers(self, name: str, shape: tuple[int, ...]) -> tuple[int, Any]:
        dtype = np.dtype(_NUMPY_NAMES.get(name, name)).newbyteorder(self._order)
        whole = np.dtype((dtype, shape))
        if whole.itemsize:
            self._align(dtype.itemsize)
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

    def _align(self, size: int) -> None:
        self._offset += -(self._offset - _HEADER_SIZE) % size


def _structure(fields: list[_Field], begin: int, end: int) -> np.dtype[Any]:
    """Return the structure of fields in a message from `begin` to `end`."""
    dtypes = [
        _structure(each.content, each.offset, end)
        if isinstance(each.content, list)
        else each.content
        for each in fields
    ]
    return np.dtype(
        {
            'names': [each.name for each in fields],
            'formats': dtypes,
            'offsets': [each.offset - begin for each in fields],
            'itemsize': end - begin,
        }
    )
