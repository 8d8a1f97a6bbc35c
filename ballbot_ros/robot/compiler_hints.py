"""Hints for the compiler of functions on numbers: what it replaces, and what it copies in place."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import FunctionType
from typing import Any, TypeVar

_F = TypeVar('_F', bound=Callable[..., Any])

ALTERNATIVES: dict[Callable[..., Any], Callable[..., Any]] = {}
"""Functions that compiled code calls instead of others."""

INLINED: set[Callable[..., Any]] = set()
"""Functions that compiled code contains instead of calling them."""


def compiled_as(alternative: _F) -> Callable[[_F], _F]:
    """Let compiled code call `alternative` instead of the decorated function, which equals it."""

    def register(function: _F) -> _F:
        ALTERNATIVES[function] = alternative
        return function

    return register


def inlined(function: _F) -> _F:
    """Let compiled code contain a function that it calls once, and that creates no arrays.

    Its named tuples of many numbers are then no arguments, which would be copied. References to its
    arrays are not counted: in every tick, that would take a quarter of the time.
    """
    INLINED.add(function)
    return function


def with_globals(function: Callable[..., Any], others: Mapping[str, object]) -> FunctionType:
    """Return a copy of a function for which other objects replace some of its module.

    So one function calls another without having it as an argument, which compiled code that is kept
    can't have.
    """
    assert isinstance(function, FunctionType)
    names = {**function.__globals__, **others}
    fresh = FunctionType(function.__code__, names, function.__name__, function.__defaults__)
    fresh.__qualname__ = function.__qualname__
    return inlined(fresh) if function in INLINED else fresh


def completed(
    function: Callable[..., Any], name: str, part: Callable[..., Any], **others: object
) -> FunctionType:
    """Return a copy of a function that calls `part` by a name, as a function of the part's module.

    So the compiler compiles both, and messages tell where `part` is.
    """
    fresh = with_globals(function, {**others, name: part, '__name__': part.__module__})
    fresh.__wrapped__ = part  # type: ignore[attr-defined]
    return fresh
