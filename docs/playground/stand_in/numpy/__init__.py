"""The part of numpy that a run needs, for a browser, where there is no numpy.

A run computes with plain numbers. Of numpy it takes single precision, unsigned words of 64 bits,
and small tables at its start; this has the same bits. Whatever is missing raises AttributeError.
"""

from __future__ import annotations

from array import array as _memory
from math import copysign, inf, nan, prod

__all__ = ['arange', 'array', 'empty', 'float32', 'inf', 'int64', 'uint64', 'zeros']


class generic:
    """A number of numpy."""


class ndarray:
    """A table: its elements row by row."""

    def __init__(self, elements, shape):
        self._elements, self.shape = elements, shape

    def __len__(self):
        return self.shape[0]

    def _at(self, where):
        row, column = where
        return row * self.shape[1] + column

    def __getitem__(self, where):
        return self._elements[self._at(where)]

    def __setitem__(self, where, value):
        self._elements[self._at(where)] = value

    def copy(self):
        return ndarray(self._elements[:], self.shape)

    def tolist(self):
        return self._elements[:]


def _words(name):
    """Return an operation of words, and of tables of words, modulo 2^64."""
    operation = getattr(int, name)

    def of_words(self, other):
        if isinstance(other, ndarray):
            return NotImplemented
        return uint64(operation(self, other) & _WORD)

    def of_tables(self, other):
        if isinstance(other, ndarray):
            pairs = zip(self._elements, other._elements, strict=True)
            return ndarray([operation(one, two) & _WORD for one, two in pairs], self.shape)
        return ndarray([operation(one, other) & _WORD for one in self._elements], self.shape)

    return of_words, of_tables


_WORD = 0xFFFF_FFFF_FFFF_FFFF


class uint64(int, generic):
    """A word of 64 bits."""


for _name in ('add', 'mul', 'and', 'or', 'xor', 'rshift', 'lshift'):
    _of_words, _of_tables = _words(f'__{_name}__')
    setattr(uint64, f'__{_name}__', _of_words)
    setattr(ndarray, f'__{_name}__', _of_tables)
    if 'shift' not in _name:
        setattr(ndarray, f'__r{_name}__', _of_tables)

_single = _memory('f', [0.0])
_new = float.__new__


class float32(float, generic):
    """A number in single precision.

    The double nearest to a sum, product or quotient of two singles rounds to the nearest single.
    """

    def __new__(cls, value):
        _single[0] = value
        return _new(cls, _single[0])


def _of_one(name):
    operation = getattr(float, name)
    return lambda number: _new(float32, operation(number))


def _of_two(name):
    """Return an operation of a single and another number, which becomes a single first."""
    operation = getattr(float, name)

    def rounded(number, other):
        if type(other) is not float32:
            _single[0] = other
            other = _single[0]
        try:
            _single[0] = operation(number, other)
        except ZeroDivisionError:
            numbers = (number, other) if name == '__truediv__' else (other, number)
            _single[0] = _by_zero(*numbers)
        return _new(float32, _single[0])

    return rounded


def _by_zero(number, zero):
    return copysign(inf, number) * copysign(1.0, zero) if number and number == number else nan


for _name in ('neg', 'abs'):
    setattr(float32, f'__{_name}__', _of_one(f'__{_name}__'))
for _name in ('add', 'sub', 'mul', 'truediv', 'radd', 'rsub', 'rmul', 'rtruediv'):
    setattr(float32, f'__{_name}__', _of_two(f'__{_name}__'))

int64 = int
float64 = float
bool_ = bool


class int8(generic):
    """Only in type hints, as the following ones."""


int32 = uint8 = intp = number = void = dtype = int8


def zeros(shape):
    shape = shape if isinstance(shape, tuple) else (shape,)
    return ndarray([0.0] * prod(shape), shape)


empty = zeros


def array(rows):
    return ndarray([each for row in rows for each in row], (len(rows), len(rows[0])))


def arange(first, end, dtype):
    return ndarray(list(range(first, end)), (end - first,))
