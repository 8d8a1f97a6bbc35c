"""Compiling the project's functions without changes."""

from types import FunctionType

import numba


def compiled(function, **options):
    """Return a function compiled by numba, with the functions of this project that it calls.

    Parameters
    ----------
    function : callable
    **options
        For ``numba.njit``; ``error_model='numpy'`` divides by zero as numpy's numbers do.
    """
    names = function.__code__.co_names
    called = {
        name: compiled(value, **options)
        for name, value in function.__globals__.items()
        if name in names
        and isinstance(value, FunctionType)
        and value.__module__.startswith('ballbot_ros')
    }
    fresh = FunctionType(function.__code__, {**function.__globals__, **called}, function.__name__)
    return numba.njit(fresh, **options)
