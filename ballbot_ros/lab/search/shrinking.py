"""Making a counterexample simpler: fewer deviations from the nominal values, smaller, rounder."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from ballbot_ros.lab.search.candidates import has_value
from ballbot_ros.lab.studies.variables import Levels, Variable

Case = dict[str, Any]
"""The values of what varies in a run, by name."""

Violates = Callable[[Sequence[Case]], Sequence[bool]]
"""Returns which of several runs violate the requirement; one that is impossible does not."""

_FRACTIONS = tuple(each / 8.0 for each in range(1, 8))
_ROUNDS = 2
_DIGITS = range(1, 5)


def shrunk(
    case: Case, variables: Sequence[Variable], nominal: Mapping[str, Any], violates: Violates
) -> Case:
    """Return a simpler case that still violates the requirement.

    What is not one of the variables keeps its value. The nominal value of one that has none is
    None.
    """
    case = _fewer(case, variables, nominal, violates)
    numbers = [
        each
        for each in variables
        if isinstance(case[each.name], int | float)
        and not isinstance(case[each.name], bool)
        and isinstance(nominal[each.name], int | float)
        and case[each.name] != nominal[each.name]
    ]
    for _ in range(_ROUNDS):
        for each in numbers:
            case = _smaller(case, each, nominal[each.name], violates)
    for each in numbers:
        if not isinstance(each.distribution, Levels):
            case = _rounder(case, each, violates)
    return case


def deviations(
    case: Case, variables: Sequence[Variable], nominal: Mapping[str, Any]
) -> tuple[str, ...]:
    """Return the variables whose values are not the nominal ones."""
    return tuple(each.name for each in variables if case[each.name] != nominal[each.name])


def _fewer(
    case: Case, variables: Sequence[Variable], nominal: Mapping[str, Any], violates: Violates
) -> Case:
    """Return the case with as many nominal values as possible."""
    names = [name for name in deviations(case, variables, nominal) if nominal[name] is not None]
    changed = True
    while changed and names:
        changed = False
        alone = violates([{**case, name: nominal[name]} for name in names])
        for name in [name for name, good in zip(names, alone, strict=True) if good]:
            simpler = {**case, name: nominal[name]}
            # The first of them is known to do, the others only with the values before.
            if not changed or violates([simpler])[0]:
                case, changed = simpler, True
                names.remove(name)
    return case


def _smaller(case: Case, variable: Variable, nominal: Any, violates: Violates) -> Case:
    """Return the case with a value as near to its nominal one as a few fractions allow."""
    name, value, of = variable.name, case[variable.name], variable.distribution
    if isinstance(of, Levels):
        between = [each for each in of.levels if abs(each - nominal) < abs(value - nominal)]
        tried = sorted(between, key=lambda each: abs(each - nominal))
    else:
        tried = [nominal + fraction * (value - nominal) for fraction in _FRACTIONS]
        if isinstance(value, int):
            tried = list(dict.fromkeys(map(round, tried)))
        tried = [each for each in tried if has_value(of, each) and each != nominal]
    return _first(case, name, tried, violates)


def _rounder(case: Case, variable: Variable, violates: Violates) -> Case:
    """Return the case with as few digits of a value as possible."""
    value = case[variable.name]
    tried: list[Any] = []
    for digits in _DIGITS:
        exponent = math.floor(math.log10(abs(value))) - digits + 1 if value else 0
        scale = 10.0 ** max(exponent, -300)  # smaller ones soon become 0
        steps = value / scale
        # As text, so that a number has no more digits than that.
        near = round(steps), math.floor(steps), math.ceil(steps)
        tried += [type(value)(float(f'{each * scale:.{digits}g}')) for each in near]
    within = [each for each in dict.fromkeys(tried) if has_value(variable.distribution, each)]
    return _first(case, variable.name, within, violates)


def _first(case: Case, name: str, values: Sequence[Any], violates: Violates) -> Case:
    """Return the case with the first of some values that violates the requirement, if any does."""
    cases = [{**case, name: each} for each in values]
    for each, good in zip(cases, violates(cases) if cases else [], strict=True):
        if good:
            return each
    return case
