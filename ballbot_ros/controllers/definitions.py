"""Comparison of classes and functions with what their definitions give."""

from __future__ import annotations

import dis
from collections.abc import Mapping, Sequence
from contextlib import suppress
from inspect import unwrap
from types import CodeType, FunctionType
from typing import Any

import numpy as np

_GENERATED = '<string>'
"""File name of the code of generated functions, such as those of a dataclass."""

_CALLS = (
    'CALL', 'CALL_FUNCTION', 'CALL_METHOD', 'EXTENDED_ARG', 'PRECALL', 'PUSH_NULL', 'SWAP', 'CACHE',
)  # fmt: skip

_PLAIN = (bool, int, float, complex, str, bytes, type(None), np.ndarray, np.number, np.bool_)


def functions_of(definition: FunctionType | type) -> list[FunctionType]:
    """Return the functions whose text is in a definition: itself, or the methods of a class."""
    if isinstance(definition, FunctionType):
        return [definition]
    return [
        each
        for value in vars(definition).values()
        for each in _functions_in(value)
        if each.__qualname__ == f'{definition.__qualname__}.{each.__name__}'
        and each.__code__.co_filename != _GENERATED
    ]


def first_difference(present: Any, defined: Any, name: str) -> str:
    """Return where a class or function differs from what its definition gives; '' if nowhere.

    Parameters
    ----------
    name : str
        The name of both, with which the answer begins, such as ``MyPid.gain``.
    """
    return _Comparison(present.__module__).difference(present, defined, name)


def state_difference(present: object, fresh: object, name: str) -> str:
    """Return in which attribute an object differs from another one of its class; '' if in none."""
    comparison = _Comparison(type(present).__module__)
    return comparison.attributes(vars(present), vars(fresh), name)


class _Comparison:
    """Compares each pair of objects once; what can't be compared counts as equal.

    Parameters
    ----------
    module : str
        Instances of this module's classes are compared by their attributes.
    """

    def __init__(self, module: str) -> None:
        self._module = module
        # With the objects, so that no later one gets the identity of one that is gone.
        self._seen: dict[tuple[int, int], tuple[Any, Any]] = {}

    def difference(self, a: Any, b: Any, name: str) -> str:
        """Return the name of the first difference; '' if there is none."""
        if a is b or (id(a), id(b)) in self._seen:
            return ''
        self._seen[id(a), id(b)] = a, b
        if isinstance(a, _PLAIN) or isinstance(b, _PLAIN):
            return '' if _are_equal(a, b) else name
        if isinstance(a, list | tuple) and isinstance(b, list | tuple):
            return self._elements(a, b, name)
        if isinstance(a, dict) and isinstance(b, dict):
            return name if a.keys() != b.keys() else self._elements(
                list(a.values()), [b[key] for key in a], name
            )  # fmt: skip
        if functions := _functions_in(a):
            return self._functions(functions, _functions_in(b), name)
        if isinstance(a, type) and isinstance(b, type):
            return self.attributes(vars(a), vars(b), name)
        if type(a).__module__ == self._module and hasattr(a, '__dict__'):
            return self.attributes(vars(a), getattr(b, '__dict__', {}), name)
        return ''

    def attributes(self, a: Mapping[str, Any], b: Mapping[str, Any], name: str) -> str:
        """Return the name of the first attribute that differs; '' if there is none."""
        for each in sorted(a.keys() | b.keys()):
            if each not in a or each not in b:
                found = '' if each.startswith('__') else f'{name}.{each}'
            elif each.startswith('__') and not isinstance(a[each], FunctionType):
                found = ''
            else:
                found = self.difference(a[each], b[each], f'{name}.{each}')
            if found:
                return found
        return ''

    def _elements(self, a: Sequence[Any], b: Sequence[Any], name: str) -> str:
        if len(a) != len(b) or any(map(self.difference, a, b, [name] * len(a))):
            return name
        return ''

    def _functions(self, a: Sequence[FunctionType], b: Sequence[FunctionType], name: str) -> str:
        def parts(function: FunctionType) -> list[Any]:
            return [function.__defaults__, function.__kwdefaults__, _closure(function)]

        same_code = [_code(each.__code__) for each in a] == [_code(each.__code__) for each in b]
        return self._elements(list(map(parts, a)), list(map(parts, b)), name) if same_code else name


def _functions_in(value: Any) -> list[FunctionType]:
    """Return the functions of a function, method or property, without their decorators."""
    parts: list[Any] = [value]
    if isinstance(value, property):
        parts = [value.fget, value.fset, value.fdel]
    originals = (unwrap(each) for each in parts if callable(each) or hasattr(each, '__wrapped__'))
    return [each for each in originals if isinstance(each, FunctionType)]


def _closure(function: FunctionType) -> list[Any]:
    """Return the values of a function's free variables that have one."""
    values = []
    for cell in function.__closure__ or ():
        with suppress(ValueError):  # a variable without a value yet
            values.append(cell.cell_contents)
    return values


def _code(code: CodeType) -> list[tuple[str, Any]]:
    """Return what code does, without its place.

    The compiler chooses between two ways to call a method, by whether the module imports its owner
    itself, so calls are left out, and both ways to load a method count as one.
    """
    content: list[tuple[str, Any]] = []
    for each in dis.get_instructions(code):
        name = each.opname.replace('LOAD_METHOD', 'LOAD_ATTR')
        value = each.argval
        if isinstance(value, CodeType):
            value = _code(value)
        elif each.opcode in dis.hasconst:
            value = repr(value)
        elif each.opcode in (*dis.hasjrel, *dis.hasjabs):
            value = None
        if name not in _CALLS:
            content.append((name, value))
    return content


def _are_equal(a: Any, b: Any) -> bool:
    """Return whether two plain values are equal; NaN equals NaN."""
    if isinstance(a, np.ndarray) or isinstance(b, np.ndarray):
        return (
            type(a) is type(b)
            and (a.dtype, a.shape) == (b.dtype, b.shape)
            and a.tobytes() == b.tobytes()
        )
    return type(a).__name__ == type(b).__name__ and bool(a == b or (a != a and b != b))
