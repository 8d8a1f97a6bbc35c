"""What the figures of a run show against time, for paper and for the interactive page alike."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ballbot_ros.analysis.style import BLUE, DARKER, ORANGE, PLANES, Line
from ballbot_ros.analysis.table import Table

NO_ECHO_CM = 255.0
"""Where a measurement without an echo is drawn [cm]: the number that the sensor then returns."""

Values = NDArray[Any]


def _all_values(values: Values) -> Values:
    return values


@dataclass(frozen=True)
class Role:
    """What a curve is: its name, and the width and dash of its line.

    Only one of several curves is `true`. `select` returns the values to draw of a column.
    """

    name: str
    width: float = 1.4
    dash: str = '-'
    select: Callable[[Values], Values] = _all_values


TRUE = Role('true', 2.2)
COMMANDED = Role('commanded', 1.2, ':')
REFERENCE = Role('reference', 0.9, '--')
ESTIMATED = Role('estimated', 0.9, '--')
READING = Role('reading − offset', 0.9, '--')
MEASURED = Role('')
ECHO = Role('echo', 3.0, '.', lambda values: np.where(np.isfinite(values), values, np.nan))
NO_ECHO = Role('no echo', 4.0, '|', lambda values: np.where(np.isinf(values), NO_ECHO_CM, np.nan))
POINTS = ('.', '|')
"""Dashes that are points instead of a line; the width is their size."""

ROLES = (TRUE, COMMANDED, REFERENCE, ESTIMATED, READING, MEASURED, ECHO, NO_ECHO)
"""The roles in the order of every legend."""


@dataclass(frozen=True)
class Curve:
    """A column of a table, of plane ``x`` or ``y`` or, if it is '', of no plane."""

    column: str
    role: Role = TRUE
    plane: str = ''

    @property
    def line(self) -> Line:
        """Its line next to the curves of the same plane only."""
        color = ORANGE if self.plane == 'y' or self.role is NO_ECHO else BLUE
        if self.plane and self.role is not TRUE:
            color = DARKER[color]
        return Line(color, self.role.width, self.role.dash, self.role.name)

    @property
    def line_of_both(self) -> Line:
        """Its line next to the curves of the other plane."""
        return PLANES['xy'.index(self.plane)] if self.plane and self.role is TRUE else self.line


@dataclass(frozen=True)
class Panel:
    """Curves of one quantity on one pair of axes.

    Attributes
    ----------
    label : str
        The quantity and its unit in brackets, as ``body pitch [°]``.
    min_span : float
        What the vertical axis spans at least, so that small changes look small.
    limits : tuple of float
        Values at which there is a dotted line.
    bounds : tuple of float or None
        The ends of the vertical axis; None if the curves decide.
    """

    label: str
    curves: tuple[Curve, ...]
    min_span: float = 0.0
    limits: tuple[float, ...] = ()
    bounds: tuple[float, float] | None = None

    @property
    def quantity(self) -> str:
        """The label without the unit."""
        return self.label.partition(' [')[0]

    @property
    def unit(self) -> str:
        """The unit."""
        return self.label.partition('[')[2].rstrip(']')

    def of_plane(self, plane: str) -> Panel:
        """Return the panel with only the curves of a plane."""
        return replace(self, curves=tuple(each for each in self.curves if each.plane == plane))

    def of_table(self, table: Table) -> Panel:
        """Return the panel without curves that have no value in a table."""
        curves = tuple(each for each in self.curves if not np.isnan(table[each.column]).all())
        return replace(self, curves=curves)


def panel_of_planes(
    label: str, curves: Iterable[tuple[Role, str]], *, min_span: float = 0.0
) -> Panel:
    """Return a panel with curves of both planes; {} in a column stands for the plane."""
    both = ((role, column, plane) for role, column in curves for plane in 'xy')
    return Panel(
        label,
        tuple(Curve(column.format(plane), role, plane) for role, column, plane in both),
        min_span,
    )
