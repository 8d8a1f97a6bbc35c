"""What the text of a study's file says to readers of its results."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import yaml

from ballbot_ros.errors import printable
from ballbot_ros.studies.distribution_reader import (
    DISTRIBUTIONS,
    GRID,
    LIST,
    LOG_UNIFORM,
    NORMAL,
    UNIFORM,
)
from ballbot_ros.studies.study import Sampling

_SAMPLINGS = {
    Sampling.RANDOM: 'independent random numbers',
    Sampling.LATIN_HYPERCUBE: 'Latin hypercube',
    Sampling.SOBOL: 'Sobol sequence, scrambled',
    Sampling.HALTON: 'Halton sequence, scrambled',
    Sampling.GRID: 'grid of all combinations',
}
_SHOWN_LEVELS = 6


@dataclass(frozen=True)
class StudyText:
    """What a study is for, and how its values were drawn.

    Attributes
    ----------
    purpose, sampling : str
        Empty if the text does not say.
    is_grid : bool
        Whether the runs are all combinations of levels.
    distributions : mapping of str to str
        Distribution of each variable, in words.
    logarithmic : frozenset of str
        Variables whose logarithms are uniform.
    """

    purpose: str = ''
    sampling: str = ''
    is_grid: bool = False
    distributions: Mapping[str, str] = field(default_factory=dict)
    logarithmic: frozenset[str] = frozenset()

    @classmethod
    def of(cls, text: str) -> StudyText:
        """Read a text; it was valid when the study ran, so what is not expected is left out."""
        try:
            data = yaml.safe_load(text)
        except yaml.YAMLError:
            return cls()
        if not isinstance(data, dict):
            return cls()
        varied = data.get('vary')
        varied = varied if isinstance(varied, dict) else {}
        given = {str(name): each for name, each in varied.items() if isinstance(each, dict)}
        sampling = str(data.get('sampling', Sampling.RANDOM.value))
        return cls(
            printable(str(data.get('purpose', ''))),
            _SAMPLINGS[Sampling(sampling)] if sampling in list(Sampling) else '',
            sampling == Sampling.GRID,
            {name: _words(each) for name, each in given.items()},
            frozenset(name for name, each in given.items() if LOG_UNIFORM in each),
        )


def _words(given: Mapping[str, object]) -> str:
    """Return a distribution in words."""
    kind = next((each for each in DISTRIBUTIONS if each in given), '')
    values = given.get(kind)
    items = [_number(each) for each in values] if isinstance(values, list) else []
    if kind == LIST:
        more = ' …' if len(items) > _SHOWN_LEVELS else ''
        return f'one of {", ".join(items[:_SHOWN_LEVELS])}{more}'
    if kind == GRID and len(items) == 3:
        return f'levels at equal distances, {items[0]} … {items[1]}'
    if kind == NORMAL and len(items) == 2:
        limits = [f'{key} {_number(given[key])}' for key in ('min', 'max') if key in given]
        return ', '.join([f'normal, {items[0]} ± {items[1]}', *limits])
    if kind in (UNIFORM, LOG_UNIFORM) and len(items) == 2:
        return f'{kind.replace("_", "-")}, {items[0]} … {items[1]}'
    return ''


def _number(value: object) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    text = f'{value:g}' if isinstance(value, int | float) else printable(str(value))
    return text.replace('-', '−') if isinstance(value, int | float) else text
