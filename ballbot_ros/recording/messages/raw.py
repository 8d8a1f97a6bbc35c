"""Serialised messages: their stamps, decoding them, and messages of a fixed layout.

Decoding with rosbags takes a third of the time of rclpy's own conversion, and most
messages of the loop are read by several nodes.

The messages of a periodic topic differ only in their stamp and in some numbers. Packing these into
the bytes around them takes a tenth of the time of encoding a message object.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import cache
from operator import attrgetter, itemgetter
from typing import Any, overload

import numpy as np
from numpy.typing import NDArray
from rosbags.interfaces import Nodetype
from rosbags.serde import SerdeError

from ballbot_ros.parameters.timing import SECOND_NS
from ballbot_ros.recording.schemas import encoder, new_message, typestore
from ballbot_ros.robot.arithmetic import Floats

# In CDR, the first field, here a time, follows four bytes of encoding.
_STAMP, _TIME = struct.Struct('<4xiI'), struct.Struct('<iI')
_STAMPS = ('std_msgs/msg/Header', 'builtin_interfaces/msg/Time')


def stamp_of(data: bytes) -> int:
    """Return the stamp [ns] of a serialised message that begins with a header or a time.

    It raises ValueError if the message is too short.
    """
    try:
        seconds, nanoseconds = _STAMP.unpack_from(data)
    except struct.error as error:
        raise ValueError(str(error)) from None
    return int(seconds) * SECOND_NS + int(nanoseconds)


def with_stamp(message: bytes, stamp_ns: int) -> bytes:
    """Return a serialised message that begins with a header or a time, with another stamp."""
    return b''.join((message[:4], _TIME.pack(*divmod(stamp_ns, SECOND_NS)), message[12:]))


def has_stamp(type_name: str) -> bool:
    """Return whether messages of this type begin with a header or a time."""
    kind, detail = typestore().fielddefs[type_name][1][0][1]
    return kind == Nodetype.NAME and detail in _STAMPS


def same_content(type_name: str) -> Callable[[bytes, bytes], bool]:
    """Return a function that compares the content of two serialised messages of a type.

    Equal messages may differ in their bytes, because padding is not cleared.
    """

    def is_same(one: bytes, other: bytes) -> bool:
        if one == other:
            return True
        decode, encode = decoder(type_name), encoder(type_name)
        return encode(decode(one)) == encode(decode(other))

    return is_same


@cache
def decoder(type_name: str) -> Callable[[bytes], Any]:
    """Return a function that decodes serialised messages of a type.

    It raises ValueError for malformed bytes, such as text that is not UTF-8.
    """
    deserialize = typestore().deserialize_cdr

    def decode(data: bytes) -> Any:
        try:
            return deserialize(data, type_name)
        except SerdeError as error:
            raise ValueError(str(error)) from None

    return decode


_STAMP_PLACES = [(4, 'i'), (8, 'I')]
"""Offset and type code of seconds and nanoseconds: four bytes of encoding precede a stamp."""

_NUMPY = {'i': 'i4', 'I': 'u4', 'f': 'f4', 'd': 'f8'}
"""numpy's names of the type codes."""

Stamps = NDArray[np.int64]
Messages = NDArray[np.void]
"""Messages of equal length: structures of their bytes, shape (n,)."""

_ELEMENT = re.compile(r'(.+)\[(\d+)\]')


class MessageLayout:
    """The layout of messages that begin with a header or a time, and that differ in some numbers.

    Parameters
    ----------
    type_name : str
        Such as ``sensor_msgs/msg/Imu``.
    numbers : iterable of str
        The numbers that differ, in the order of :meth:`encode`, such as ``vector.x`` or
        ``position[0]``. Each is a float32 or float64.
    constants : mapping of str to object
        The other fields whose values are not the defaults, such as ``header.frame_id``. An array
        with numbers that differ is one of them, because its length is constant.
    identity : str
        A constant that every message must have; '' if a message may differ in all of them.
    """

    _template: bytes
    _row: np.dtype[np.void]
    _pack: Callable[..., bytes]
    _unpack: Callable[[bytes], tuple[Any, ...]]
    _size: int
    _constants: tuple[bytes, ...]
    _interleave: Callable[[Sequence[Any]], tuple[Any, ...]]
    _pick_constants: Callable[[Sequence[Any]], tuple[Any, ...]]
    _pick_numbers: Callable[[Sequence[Any]], tuple[Any, ...]]

    def __init__(
        self,
        type_name: str,
        numbers: Iterable[str] = (),
        constants: Mapping[str, Any] | None = None,
        *,
        identity: str = '',
    ) -> None:
        self.type_name = type_name
        self._names = tuple(numbers)
        self._identity = identity
        self._fixed = constants or {}
        self._expected = self._fixed.get(identity)
        self._decode = decoder(type_name)

    def __getattr__(self, name: str) -> Any:
        """Build the layout before it is used first: that takes milliseconds."""
        if name not in MessageLayout.__annotations__:
            raise AttributeError(name)
        message = new_message(self.type_name)
        for field, value in self._fixed.items():
            _set(message, field, value)
        marks = [1.1 + number for number in range(len(self._names))]
        for field, mark in zip(self._names, marks, strict=True):
            _set(message, field, mark)
        self._build(encoder(self.type_name)(message), marks)
        return getattr(self, name)

    def _build(self, data: bytes, marks: Sequence[float]) -> None:
        """Divide a message into constants and numbers, which it finds by their values."""
        places = [*_STAMP_PLACES, *(_find(data, mark) for mark in marks)]
        order = {place: number for number, place in enumerate(places)}
        formats, constants, numbers, end = ['<'], [], [], 0
        for offset, code in [*sorted(places), (len(data), '')]:
            if offset > end:
                formats.append(f'{offset - end}s')
                constants.append(data[end:offset])
                numbers.append(-1)
            if code:
                formats.append(code)
                numbers.append(order[offset, code])
                end = offset + struct.calcsize(code)
        self._template = data
        self._row = np.dtype({
            'names': [str(number) for number in range(len(places))],
            'formats': [f'<{_NUMPY[code]}' for _, code in places],
            'offsets': [offset for offset, _ in places],
            'itemsize': len(data),
        })  # fmt: skip
        whole = struct.Struct(''.join(formats))
        self._pack, self._unpack, self._size = whole.pack, whole.unpack, whole.size
        self._constants = tuple(constants)
        is_constant = [number < 0 for number in numbers]
        of_constants = iter(range(len(constants)))
        self._interleave = _picker(
            next(of_constants) if fixed else len(constants) + number
            for fixed, number in zip(is_constant, numbers, strict=True)
        )
        self._pick_constants = _picker(i for i, fixed in enumerate(is_constant) if fixed)
        self._pick_numbers = _picker(
            numbers.index(i) for i in range(len(_STAMP_PLACES), len(places))
        )

    @overload
    def encode(self, stamp_ns: int, *numbers: float) -> bytes: ...

    @overload
    def encode(self, stamp_ns: Stamps, *numbers: Floats) -> Messages: ...

    def encode(self, stamp_ns: Any, *numbers: Any) -> bytes | Messages:
        """Return the message with this stamp [ns] and these numbers, as CDR.

        With a column instead of each number, return the messages with those of each row.
        """
        if isinstance(stamp_ns, np.ndarray):
            columns = (*divmod(stamp_ns, SECOND_NS), *numbers)
            return fill(self._template, self._row, len(stamp_ns), columns)
        parts = self._constants + divmod(stamp_ns, SECOND_NS) + numbers
        return self._pack(*self._interleave(parts))

    def decode(self, data: bytes) -> tuple[float, ...]:
        """Return the numbers of a message, also of one with other constants or another layout.

        Raises
        ------
        ValueError
            If it is malformed, or differs in its identity.
        IndexError
            If an array is too short.
        """
        if len(data) == self._size:
            parts = self._unpack(data)
            if self._pick_constants(parts) == self._constants:
                return self._pick_numbers(parts)
        message = self._decode(data)
        if self._identity and (found := _get(message, self._identity)) != self._expected:
            raise ValueError(f'{self._identity}: {found}, not {self._expected}')
        return tuple(float(_get(message, name)) for name in self._names)


def fill(
    template: bytes, row: np.dtype[np.void], count: int, columns: Iterable[object]
) -> Messages:
    """Return copies of a message with the numbers of each row of the columns in its fields."""
    rows = np.frombuffer(bytearray(template * count), row)
    for name, column in zip(row.names or (), columns, strict=True):
        rows[name] = column
    return rows.view(f'V{len(template)}')  # copies of these keep the bytes between the fields


def elements(name: str, count: int) -> list[str]:
    """Return the names of the first numbers of an array, for :class:`MessageLayout`."""
    return [f'{name}[{index}]' for index in range(count)]


def _find(data: bytes, number: float) -> tuple[int, str]:
    """Return offset and type code of the only occurrence of a number."""
    marks = {code: struct.pack(f'<{code}', number) for code in 'fd'}
    ((code, mark),) = ((code, mark) for code, mark in marks.items() if data.count(mark) == 1)
    return data.index(mark), code


def _picker(indices: Iterable[int]) -> Callable[[Sequence[Any]], tuple[Any, ...]]:
    """Return the function that picks items of a sequence."""
    wanted = tuple(indices)
    if len(wanted) > 1:
        return itemgetter(*wanted)
    return lambda items: tuple(items[index] for index in wanted)


def _get(message: object, name: str) -> Any:
    if element := _ELEMENT.fullmatch(name):
        return attrgetter(element[1])(message)[int(element[2])]
    return attrgetter(name)(message)


def _set(message: object, name: str, value: object) -> None:
    if element := _ELEMENT.fullmatch(name):
        attrgetter(element[1])(message)[int(element[2])] = value
        return
    owner, _, field = name.rpartition('.')
    value = list(value) if isinstance(value, list) else value
    setattr(attrgetter(owner)(message) if owner else message, field, value)
