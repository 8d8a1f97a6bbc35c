"""Figures of the benchmark with their bars, as a table and as JSON."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from statistics import median
from typing import Any

from rich.table import Table

REAL_TIME, MILLISECONDS, SECONDS, RATIO = '×', 'ms', 's', ''
MEGABYTES, BYTES = 'MB', 'B'


@dataclass(frozen=True)
class Figure:
    """A measured figure.

    Attributes
    ----------
    name : str
        Its key in the JSON object.
    label : str
    unit : str
    values : sequence of float
        One per repeat.
    bar, aim : float or None
        Required minimum, and a desirable value.
    at_most : bool
        Whether they are maxima.
    """

    name: str
    label: str
    unit: str
    values: Sequence[float]
    bar: float | None = None
    aim: float | None = None
    at_most: bool = False

    @property
    def median(self) -> float:
        """The value compared with the bar."""
        return median(self.values)

    @property
    def verdict(self) -> str | None:
        """``reached``, ``aim reached`` or ``missed``; None without a bar."""
        if self.bar is None:
            return None
        if not self._reaches(self.bar):
            return 'missed'
        return 'aim reached' if self.aim and self._reaches(self.aim) else 'reached'

    def _reaches(self, value: float) -> bool:
        return self.median <= value if self.at_most else self.median >= value

    def as_json(self) -> dict[str, Any]:
        """Return the figure for the JSON object."""
        return {
            'label': self.label,
            'unit': self.unit,
            'values': list(self.values),
            'median': self.median,
            'min': min(self.values),
            'max': max(self.values),
            'bar': self.bar,
            'aim': self.aim,
            'at_most': self.at_most,
            'verdict': self.verdict,
        }


_COLOURS = {'missed': 'red', 'reached': 'green', 'aim reached': 'green'}


def table_of(figures: Sequence[Figure], title: str) -> Table:
    """Return the figures as a table."""
    table = Table(title=title, title_justify='left')
    table.add_column('figure', no_wrap=True)
    table.add_column('median', justify='right', no_wrap=True)
    table.add_column('min – max', justify='right', no_wrap=True)
    table.add_column('bar (aim)', no_wrap=True)
    table.add_column('verdict', no_wrap=True)
    for figure in figures:
        least, most = _short(min(figure.values)), _short(max(figure.values))
        bar = '' if figure.bar is None else f'{"≤" if figure.at_most else "≥"} {figure.bar:g}'
        aim = '' if figure.aim is None else f' ({figure.aim:g})'
        verdict = figure.verdict or ''
        table.add_row(
            figure.label,
            f'{_short(figure.median)} {figure.unit}'.rstrip(),
            f'{least} – {most}',
            bar + aim,
            f'[{_COLOURS[verdict]}]{verdict}[/]' if verdict else '',
        )
    return table


def _short(value: float) -> str:
    return f'{value:.1f}' if value >= 10.0 else f'{value:.2f}'


def as_json(figures: Sequence[Figure]) -> Mapping[str, Any]:
    """Return the figures by name."""
    return {figure.name: figure.as_json() for figure in figures}
