"""The project's functions on plain numbers, for arrays.

There is one implementation of each law, on plain floats. Where many trajectories are needed at
once, the same code runs on arrays, element by element.
"""

from __future__ import annotations

from collections.abc import Callable
from types import FunctionType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ballbot_ros.robot.numerics import elementary

Floats = NDArray[np.float64]


def for_arrays(function: Callable[..., Any]) -> Callable[..., Any]:
    """Return a function on numbers as one on arrays, together with the functions that it calls.

    It must not branch on its arguments other than by `min`, `max` and `sine_cosine`, nor assign to
    them in place. The sines are numpy's: results can differ from those on numbers in the last
    place.
    """
    assert isinstance(function, FunctionType)
    names = set(function.__code__.co_names)
    replaced: dict[str, Any] = {}
    for name, value in function.__globals__.items():
        if name not in names:
            continue
        if value is elementary.sine_cosine:
            replaced[name] = _sine_cosine
        elif isinstance(value, FunctionType) and value.__module__.startswith('ballbot_ros'):
            replaced[name] = for_arrays(value)
    replaced.update((name, each) for name, each in _BUILTINS.items() if name in names)
    return FunctionType(function.__code__, {**function.__globals__, **replaced}, function.__name__)


def _sine_cosine(angle: Floats) -> tuple[Floats, Floats]:
    return np.sin(angle), np.cos(angle)


_BUILTINS: dict[str, Callable[..., Any]] = {'min': np.minimum, 'max': np.maximum}
