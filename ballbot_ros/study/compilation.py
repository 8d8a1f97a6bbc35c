"""The project's functions, compiled by numba as they are."""

from __future__ import annotations

import dis
from collections.abc import Callable
from types import CodeType, FunctionType
from typing import Any

from ballbot_ros.errors import BallbotError

_PACKAGE = 'ballbot_ros'
_compiled: dict[FunctionType, Any] = {}


class CompilationError(BallbotError):
    """Studies can't be compiled here."""


def compiled(function: Callable[..., Any]) -> Callable[..., Any]:
    """Return a function of this project compiled, together with the functions that it calls.

    The results are those of the function itself, bit for bit: without `fastmath`, numba keeps the
    operations of IEEE arithmetic and their order. A division by zero gives what numpy's numbers
    give. The functions get no decorator, so nothing else needs numba.

    Raises
    ------
    CompilationError
        If numba is not installed.
    """
    numba = _numba()
    assert isinstance(function, FunctionType)
    known = _compiled.get(function)
    if known is None:
        called = {
            name: compiled(value)
            for name in _global_names(function.__code__)
            if isinstance(value := function.__globals__.get(name), FunctionType)
            and value.__module__.startswith(_PACKAGE)
        }
        fresh = FunctionType(
            function.__code__, {**function.__globals__, **called}, function.__name__
        )
        fresh.__qualname__ = function.__qualname__
        known = numba.njit(fresh, error_model='numpy')
        _compiled[function] = known
    return known


def _global_names(code: CodeType) -> set[str]:
    """Return the names of the module that code uses, not those of attributes."""
    names = {each.argval for each in dis.get_instructions(code) if each.opname == 'LOAD_GLOBAL'}
    inner = [_global_names(each) for each in code.co_consts if isinstance(each, CodeType)]
    return names.union(*inner)


def _numba() -> Any:
    try:
        import numba
    except ImportError:
        raise CompilationError(
            "compiled runs need numba: pip install 'ballbot_ros[study]'"
        ) from None
    return numba
