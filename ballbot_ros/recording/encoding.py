"""Messages without a graph: blank ones, and their CDR encoding.

An encoder is generated once for each type, as Python source in which neighbouring numbers share
one call of `struct`: two to four times as fast as a general serialiser. It takes any object with
the message's attributes.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from functools import cache
from typing import Any

from rosbags.interfaces import Nodetype

from ballbot_ros.recording.schemas import schema, typestore

_Description = tuple[Nodetype, Any]
"""A field's kind with: a number type or 'string', a message type, or an element and a count."""

_CODES = {
    'bool': '?',
    'byte': 'b',
    'char': 'B',
    'int8': 'b',
    'uint8': 'B',
    'int16': 'h',
    'uint16': 'H',
    'int32': 'i',
    'uint32': 'I',
    'int64': 'q',
    'uint64': 'Q',
    'float32': 'f',
    'float64': 'd',
}
_BLANKS = {'?': False, 'f': 0.0, 'd': 0.0}
_DEFAULTS: dict[tuple[str, str], Any] = {
    ('geometry_msgs/msg/Quaternion', 'w'): 1.0,
    ('sensor_msgs/msg/NavSatStatus', 'status'): -2,
}
"""The defaults in Jazzy's .msg files that are not zero; rosbags does not keep them."""

_ENCAPSULATION_SIZE = 4
_PADDING = tuple(bytes(size) for size in range(8))


def new_message(type_name: str) -> Any:
    """Make a message of `type_name` with the defaults of its definition.

    Returns
    -------
    object
        A rosbags message: fixed arrays are lists of zeros, sequences are empty lists.

    Raises
    ------
    RecordingError
        If ROS 2 Jazzy has no such type.
    """
    schema(type_name)
    store = typestore()
    return store.types[type_name](
        *(
            _DEFAULTS.get((type_name, name), _blank(description))
            for name, description in store.fielddefs[type_name][1]
        )
    )


def _blank(description: _Description) -> Any:
    kind, detail = description
    if kind == Nodetype.NAME:
        return new_message(detail)
    if kind == Nodetype.SEQUENCE:
        return []
    if kind == Nodetype.ARRAY:
        element, count = detail
        return [_blank(element) for _ in range(count)]
    return '' if detail[0] == 'string' else _BLANKS.get(_CODES[detail[0]], 0)


@cache
def encoder(type_name: str) -> Callable[[Any], bytes]:
    """Return the function that encodes a message of `type_name` as little-endian CDR.

    Arrays and sequences may be any Python sequence of numbers; lists are the fastest. The function
    raises `struct.error` if a number does not fit its field, or too few or too many fill a message.

    Raises
    ------
    RecordingError
        If ROS 2 Jazzy has no such type.
    """
    schema(type_name)
    return _Source(type_name).compile()


class _Source:
    """Python source that appends a message's fields to the bytearray ``out``.

    `_modulus` and `_residue` are what is known of the write position (after the encapsulation
    header) while the source is written: position ≡ residue (mod modulus).
    """

    def __init__(self, type_name: str) -> None:
        self._lines: list[str] = []
        self._indent = ' '
        self._names: dict[str, Any] = {'PADDING': _PADDING, 'pack': struct.pack}
        self._locals = 0
        self._format = '<H2x'
        self._values = ['0x0100']
        self._modulus, self._residue = 8, 0
        self._message(type_name, 'message')
        self._flush()

    def compile(self) -> Callable[[Any], bytes]:
        source = '\n'.join(
            ['def encode(message):', ' out = bytearray()', *self._lines, ' return bytes(out)']
        )
        exec(source, self._names)
        encode: Callable[[Any], bytes] = self._names['encode']
        return encode

    def _line(self, text: str) -> None:
        self._lines.append(self._indent + text)

    def _local(self, expression: str) -> str:
        self._locals += 1
        self._line(f'v{self._locals} = {expression}')
        return f'v{self._locals}'

    def _flush(self) -> None:
        """Write the numbers collected so far with one call."""
        if self._values:
            pack = f'pack{len(self._names)}'
            self._names[pack] = struct.Struct(self._format).pack
            self._line(f'out += {pack}({", ".join(self._values)})')
        self._format, self._values = '<', []

    def _align(self, size: int) -> None:
        if self._modulus >= size:
            padding = -self._residue % size
            self._format += 'x' * padding
            self._residue += padding
        else:
            self._flush()
            self._line(f'out += PADDING[{_ENCAPSULATION_SIZE} - len(out) & {size - 1}]')
            self._modulus, self._residue = size, 0

    def _numbers(self, code: str, expression: str, count: int = 1) -> None:
        size = struct.calcsize(code)
        self._align(size)
        self._format += f'{count}{code}'
        self._values.append(expression)
        self._residue += count * size

    def _message(self, type_name: str, expression: str) -> None:
        for name, description in typestore().fielddefs[type_name][1]:
            self._field(f'{expression}.{name}', description)

    def _field(self, expression: str, description: _Description) -> None:
        kind, detail = description
        if kind == Nodetype.NAME:
            self._message(detail, self._local(expression))
        elif kind == Nodetype.BASE and detail[0] == 'string':
            self._string(expression)
        elif kind == Nodetype.BASE:
            self._numbers(_CODES[detail[0]], expression)
        else:
            element, count = detail
            numbers = element[0] == Nodetype.BASE and element[1][0] != 'string'
            if numbers and kind == Nodetype.ARRAY:
                self._numbers(_CODES[element[1][0]], f'*{expression}', count)
                return
            values = self._local(expression)
            self._numbers('I', f'len({values})')
            self._flush()
            if numbers:
                self._sequence(_CODES[element[1][0]], values)
            else:
                self._loop(element, values)

    def _string(self, expression: str) -> None:
        text = self._local(f"({expression} + '\\0').encode()")
        self._numbers('I', f'len({text})')
        self._flush()
        self._line(f'out += {text}')
        self._modulus, self._residue = 1, 0

    def _sequence(self, code: str, values: str) -> None:
        size = struct.calcsize(code)
        if size == 8:
            self._line(f'if len({values}): out += PADDING[{_ENCAPSULATION_SIZE} - len(out) & 7]')
        self._line(f"out += pack(f'<{{len({values})}}{code}', *{values})")
        self._modulus, self._residue = min(size, 4), 0

    def _loop(self, element: _Description, values: str) -> None:
        item = f'{values}_item'
        self._line(f'for {item} in {values}:')
        self._indent += ' '
        self._modulus, self._residue = 1, 0
        self._field(item, element)
        self._flush()
        self._indent = self._indent[:-1]
        self._modulus, self._residue = 1, 0
