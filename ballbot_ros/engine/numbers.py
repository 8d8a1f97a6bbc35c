"""The parameters of a node as plain numbers, as the engine's constants are made of them."""

from __future__ import annotations

from functools import cache
from types import SimpleNamespace
from typing import Any, Literal, get_args, get_origin, get_type_hints

from ballbot_ros.parameters import NodeParameters


@cache
def choice(cls: type, name: str, value: str) -> int:
    """Return the number that stands for a value of a choice of a dataclass."""
    return get_args(get_type_hints(cls)[name]).index(value)


@cache
def _choices(cls: type) -> dict[str, tuple[Any, ...]]:
    words = {
        name: get_args(kind)
        for name, kind in get_type_hints(cls).items()
        if get_origin(kind) is Literal
    }
    return {name: each for name, each in words.items() if isinstance(each[0], str)}


def numbers_of(parameters: NodeParameters) -> SimpleNamespace:
    """Return the parameters of a node by their names, choices as in :func:`choice`."""
    values = SimpleNamespace(**parameters.values())
    cls: Any = type(parameters)
    for name, words in _choices(cls).items():
        setattr(values, name, words.index(getattr(values, name)))
    return values
