"""The plots of the page: which signals each shows, and their curves."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ballbot_ros.analysis.drawing import DUTY, PITCH, POSITION
from ballbot_ros.analysis.style import BLUE, ORANGE
from ballbot_ros.viewer.colours import GHOST, GHOST_LIGHT, Colour

Floats = NDArray[np.float64]

_DASHED, _DOTTED = (5.0, 4.0), (1.5, 3.0)
_PLANE_COLOURS = BLUE, ORANGE
_GHOST_PREFIX = 'ghost_'


@dataclass(frozen=True)
class Curve:
    """A curve: a column of a table of signals, its name in the legend, and its line.

    `width` is in pixels, `dash` the lengths of strokes and gaps in pixels. With `has_points`, its
    samples are points wherever there is room for them.
    """

    column: str
    label: str
    colour: str
    width: float = 1.5
    dash: tuple[float, ...] = ()
    has_points: bool = False


@dataclass(frozen=True)
class PlotKind:
    """A plot of signals against time.

    Attributes
    ----------
    label : str
        The quantity with its unit.
    curves : tuple of Curve
        The actual values first, then what the controller commands (dashed) or estimates (dotted).
    scale : float
        Factor from the unit of the signals to that of the plot.
    least : tuple of float or None
        What the axis shows at least, so that noise does not look large; None for a quantity without
        a usual value.
    is_default : bool
        Whether the plot is shown until the user chooses.
    """

    label: str
    curves: tuple[Curve, ...]
    scale: float = 1.0
    least: tuple[float, float] | None = None
    is_default: bool = False

    @property
    def columns(self) -> frozenset[str]:
        """The names of the columns that it can show."""
        return frozenset(curve.column for curve in self.curves)

    def with_ghost(self) -> PlotKind:
        """Return the plot with the actual values of a second run, behind the others."""
        actual = [curve for curve in self.curves if not curve.dash]
        return replace(self, curves=(*map(_ghost_of, actual), *self.curves))


@dataclass(frozen=True)
class PlotData:
    """The curves of a plot and their values.

    Attributes
    ----------
    time : ndarray, shape (n,)
        Time [s], increasing.
    values : tuple of ndarray, each of shape (n,)
        The values of each curve in the unit of the plot; NaN where there are none, and infinite
        for a sonar without an echo.
    """

    curves: tuple[Curve, ...]
    time: Floats
    values: tuple[Floats, ...]


def ghost_columns(columns: Mapping[str, Floats]) -> dict[str, Floats]:
    """Return the columns of a second run under the names that :meth:`PlotKind.with_ghost` uses."""
    return {_GHOST_PREFIX + name: values for name, values in columns.items()}


def plot_data(
    kind: PlotKind, time: Floats, columns: Mapping[str, Floats], *, keeps_unknown: bool = False
) -> PlotData:
    """Return what a plot shows of a table; `keeps_unknown` keeps curves without any value."""
    known = [
        curve
        for curve in kind.curves
        if curve.column in columns and (keeps_unknown or _has_values(columns[curve.column]))
    ]
    values = tuple(columns[curve.column] * kind.scale for curve in known)
    return PlotData(tuple(known), time, values)


def offered_kinds(names: Iterable[str]) -> list[PlotKind]:
    """Return the plots that can show at least one of the columns `names`."""
    known = frozenset(names)
    return [kind for kind in PLOT_KINDS if kind.columns & known]


def topic_kind(topic: str, column: str) -> PlotKind:
    """Return the plot of a column of a recorded topic."""
    return PlotKind(f'{topic} {column}', (Curve(column, 'value', BLUE, has_points=True),))


def _has_values(values: Floats) -> bool:
    return not np.isnan(values).all()


def _ghost_of(curve: Curve) -> Curve:
    colour = GHOST_LIGHT if curve.colour == ORANGE else GHOST
    return replace(
        curve,
        column=_GHOST_PREFIX + curve.column,
        label=f'ghost {curve.label}',
        colour=_hex(colour),
        width=1.0,
    )


def _hex(colour: Colour) -> str:
    return '#{:02x}{:02x}{:02x}'.format(*colour)


def _planes(
    name: str, unit: str, label: str = '', width: float = 1.5, dash: tuple[float, ...] = ()
) -> tuple[Curve, ...]:
    """Return the curves of a signal for planes x and y."""
    return tuple(
        Curve(f'{name}_{plane}_{unit}', f'{label} {plane}'.strip(), colour, width, dash)
        for plane, colour in zip('xy', _PLANE_COLOURS, strict=True)
    )


def _commanded(name: str, unit: str, label: str) -> tuple[Curve, ...]:
    return _planes(name, unit, label, 1.2, _DASHED)


def _estimated(name: str, unit: str, label: str = 'estimated') -> tuple[Curve, ...]:
    return _planes(name, unit, label, 1.2, _DOTTED)


PLOT_KINDS: Sequence[PlotKind] = (
    PlotKind(
        PITCH.label,
        (*_planes('pitch', 'deg'), *_estimated('estimated_pitch', 'deg')),
        least=(-1.0, 1.0),
        is_default=True,
    ),
    PlotKind(
        POSITION.label,
        (
            *_planes('position', 'm'),
            *_commanded('reference_position', 'm', 'reference'),
            *_estimated('estimated_position', 'm'),
        ),
        scale=100.0,
        is_default=True,
    ),
    PlotKind(DUTY.label, _planes('duty', 'percent'), least=(-10.0, 10.0), is_default=True),
    PlotKind(
        'sonar [cm]',
        (Curve('distance_m', 'distance', BLUE),),
        scale=100.0,
        least=(0.0, 50.0),
        is_default=True,
    ),
    PlotKind(
        'speed [cm/s]',
        (
            *_planes('speed', 'm_per_s'),
            *_commanded('reference_speed', 'm_per_s', 'reference'),
            *_estimated('commanded_speed', 'm_per_s', 'commanded'),
        ),
        scale=100.0,
        least=(-5.0, 5.0),
    ),
    PlotKind('pitch rate [°/s]', _planes('pitch_rate', 'deg_per_s'), least=(-5.0, 5.0)),
    PlotKind(
        'gyro [°/s]',
        (
            *_planes('gyro', 'deg_per_s'),
            *_estimated('estimated_gyro_offset', 'deg_per_s', 'offset'),
        ),
    ),
    PlotKind('encoder [°]', _planes('encoder', 'deg')),
    PlotKind('motor rate [°/s]', _planes('motor_rate', 'deg_per_s'), least=(-20.0, 20.0)),
    PlotKind(
        'motor torque [mN·m]', _planes('motor_torque', 'n_m'), scale=1000.0, least=(-10.0, 10.0)
    ),
    PlotKind('sticks [%]', _planes('stick', 'percent'), least=(-10.0, 10.0)),
    PlotKind('battery [V]', (Curve('battery_v', 'voltage', BLUE),)),
)
"""The plots in the order of the page."""
