"""Positions of the numbers in CDR messages, for reading those of many messages at once."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from mcap.records import Schema
from numpy.typing import NDArray
from rosbags.interfaces import Nodetype
from rosbags.typesys.store import Typestore

from ballbot_ros.recording.batch import Batch, Rows, gather
from ballbot_ros.recording.schemas import recorded_typestore

_HEAD_SIZE = 4
"""Encapsulation header; alignment counts from its end."""

_NUMPY_NAMES = {'char': 'uint8'}


@dataclass(frozen=True)
class Layout:
    """The form shared by all messages of a type with equal texts and sequence lengths.

    Attributes
    ----------
    kind : numpy.dtype
        A structure as long as the message, with a field for each number, array or sequence of
        numbers, and nested message.
    places : ndarray, shape (k,)
        Positions of the bytes that determine the form: encoding, lengths and texts.
    form : ndarray, shape (k,)
        Their required values.
    """

    kind: np.dtype[Any]
    places: Rows
    form: NDArray[np.uint8]

    @classmethod
    def of(cls, data: bytes, definition: Schema) -> Layout:
        """Return the layout of a message, which must be valid for its recorded type."""
        walk = _Walk(data, recorded_typestore(definition))
        fields = walk.message(definition.name)
        kind = _structure(fields, 0, len(data))
        places = np.array(walk.form, np.intp)
        return cls(kind, places, np.frombuffer(data, np.uint8)[places])

    def read(self, batch: Batch, rows: Rows) -> tuple[NDArray[np.bool_], NDArray[Any]]:
        """Return which messages of a batch have this form, and their numbers.

        The numbers are a record array with the field names of the type.
        """
        fits = batch.sizes[rows] == self.kind.itemsize
        records = gather(batch.data, batch.starts[rows[fits]], self.kind)
        content = records.view(np.uint8).reshape(-1, self.kind.itemsize)
        alike = (content[:, self.places] == self.form).all(axis=1)
        if not alike.all():
            fits[fits], records = alike, records[alike]
        return fits, records.view(np.recarray)


@dataclass(frozen=True)
class _Field:
    """A field: its position in the message [byte], and its type or the fields of its message."""

    name: str
    place: int
    kind: Any


class _Walk:
    """Parses a message once and notes everything that determines its form."""

    def __init__(self, data: bytes, store: Typestore) -> None:
        self._data, self._store = data, store
        self._order: Literal['<', '>'] = '<' if data[1] else '>'
        self._place = _HEAD_SIZE
        self.form = list(range(_HEAD_SIZE))

    def message(self, type_name: str) -> list[_Field]:
        """Return the fields of a message that begins here, except texts and lists of messages."""
        _, descriptions = self._store.fielddefs[type_name]
        fields = []
        for name, description in descriptions:
            kind = self._item(description)
            if kind is not None:
                fields.append(_Field(name, *kind))
        return fields

    def _item(self, description: Any) -> tuple[int, Any] | None:
        node, detail = description
        if node == Nodetype.NAME:
            return self._place, self.message(detail)
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
        kind = np.dtype(_NUMPY_NAMES.get(name, name)).newbyteorder(self._order)
        whole = np.dtype((kind, shape))
        if whole.itemsize:
            self._align(kind.itemsize)
        place = self._place
        self._place += whole.itemsize
        return place, whole

    def _text(self) -> None:
        length = self._length()
        self.form += range(self._place, self._place + length)
        self._place += length

    def _length(self) -> int:
        place, kind = self._numbers('uint32', ())
        self.form += range(place, self._place)
        return int(np.frombuffer(self._data, kind, 1, place)[0])

    def _align(self, size: int) -> None:
        self._place += -(self._place - _HEAD_SIZE) % size


def _structure(fields: list[_Field], begin: int, end: int) -> np.dtype[Any]:
    """Return the structure of fields in a message from `begin` to `end`."""
    kinds = [
        _structure(each.kind, each.place, end) if isinstance(each.kind, list) else each.kind
        for each in fields
    ]
    return np.dtype(
        {
            'names': [each.name for each in fields],
            'formats': kinds,
            'offsets': [each.place - begin for each in fields],
            'itemsize': end - begin,
        }
    )
