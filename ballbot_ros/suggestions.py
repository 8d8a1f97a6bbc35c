"""Hints about misspelt names."""

from __future__ import annotations

from collections.abc import Iterable
from difflib import get_close_matches

_SIMILARITY = 0.65


def similar(name: str, known: Iterable[str], prefix: str = '') -> str:
    """Return the `known` names most similar to `name`, as in ``a or b``, each after `prefix`."""
    return ' or '.join(
        prefix + each for each in get_close_matches(name, sorted(known), cutoff=_SIMILARITY)
    )


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """Return a question to follow a misspelt `name`; '' if no `known` one is similar."""
    found = similar(name, known)
    return f' (did you mean {found}?)' if found else ''
