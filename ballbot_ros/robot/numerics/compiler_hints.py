"""Hints for the compiler of functions on numbers: what it replaces, and what it copies in place."""

from __future__ import annotations

from collections.abc import Callable
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
    """Let compiled code contain a function that it calls once.

    Its named tuples of many numbers are then no arguments, which would be copied.
    """
    INLINED.add(function)
    return function
