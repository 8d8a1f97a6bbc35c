"""Hints about misspelt names."""

from __future__ import annotations

from collections.abc import Iterable
from difflib import SequenceMatcher

_MOST_HINTS = 3


def similar(name: str, known: Iterable[str], prefix: str = '') -> str:
    """Return the `known` names most similar to `name`, as in ``a or b``, each after `prefix`."""
    likeness = {each: _likeness(name, each) for each in sorted(known)}
    alike = [each for each in likeness if _may_be_meant(name, each, likeness[each])]
    best = sorted(alike, key=likeness.__getitem__, reverse=True)[:_MOST_HINTS]
    return ' or '.join(prefix + each for each in best)


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """Return a question to follow a misspelt `name`; '' if no `known` one is similar."""
    found = similar(name, known)
    return f' (did you mean {found}?)' if found else ''


def _likeness(name: str, known: str) -> float:
    """Return the part of the longer name's letters that both have in the same order, 0 … 1."""
    blocks = SequenceMatcher(None, name, known, autojunk=False).get_matching_blocks()
    return sum(block.size for block in blocks) / max(len(name), len(known))


def _may_be_meant(name: str, known: str, likeness: float) -> bool:
    """Tell whether at most one letter in three is wrong, or `name` is the beginning of `known`."""
    return likeness >= 2 / 3 or (name != '' and known.startswith(name))
