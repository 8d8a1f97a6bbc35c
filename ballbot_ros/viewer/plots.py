"""The plots in the panel, with one time axis, zoom and cursor for all."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import viser
from viser import uplot

from ballbot_ros.analysis.figure_parts import (
    BLUE,
    ORANGE,
    Curve,
    Panel,
    Role,
    envelope,
    panel_of_planes,
)
from ballbot_ros.analysis.panels import BATTERY, DUTY, PITCH, POSITION, SPEED, STICKS
from ballbot_ros.parameters.timing import TICK_S
from ballbot_ros.robot.arithmetic import Floats
from ballbot_ros.viewer.playback_run import PlaybackRun
from ballbot_ros.viewer.robot import GHOST, GHOST_LIGHT

_DASHED, _DOTTED = (5.0, 4.0), (1.5, 3.0)
_GHOST_PREFIX = 'ghost_'


@dataclass(frozen=True)
class PlotCurve:
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
    curves: tuple[PlotCurve, ...]
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

    curves: tuple[PlotCurve, ...]
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
        if curve.column in columns and (keeps_unknown or not np.isnan(columns[curve.column]).all())
    ]
    values = tuple(columns[curve.column] * kind.scale for curve in known)
    return PlotData(tuple(known), time, values)


def offered_kinds(names: Iterable[str]) -> list[PlotKind]:
    """Return the plots that can show at least one of the columns `names`."""
    known = frozenset(names)
    return [kind for kind in PLOT_KINDS if kind.columns & known]


def topic_kind(topic: str, column: str) -> PlotKind:
    """Return the plot of a column of a recorded topic."""
    return PlotKind(f'{topic} {column}', (PlotCurve(column, 'value', BLUE, has_points=True),))


def _ghost_of(curve: PlotCurve) -> PlotCurve:
    red, green, blue = GHOST_LIGHT if curve.colour == ORANGE else GHOST
    return replace(
        curve,
        column=_GHOST_PREFIX + curve.column,
        label=f'ghost {curve.label}',
        colour=f'#{red:02x}{green:02x}{blue:02x}',
        width=1.0,
    )


_LINES = {Role.REFERENCE: (1.2, _DASHED)}
_LINES |= dict.fromkeys((Role.COMMANDED, Role.ESTIMATED, Role.OFFSET), (1.2, _DOTTED))
"""Width and dash of the curves that are no actual values."""


def _kind(
    panel: Panel, least: tuple[float, float] | None = None, *, is_default: bool = False
) -> PlotKind:
    """Return the plot of a panel."""
    curves = []
    for each in panel.curves:
        role = '' if each.role is Role.TRUE else each.role.label
        label = ' '.join(filter(None, (role, each.plane))) or panel.quantity
        colour = ORANGE if each.plane == 'y' else BLUE
        curves.append(PlotCurve(each.column, label, colour, *_LINES.get(each.role, ())))
    return PlotKind(panel.label, tuple(curves), panel.scale, least, is_default)


def _of_planes(
    label: str, column: str, least: tuple[float, float] | None = None, scale: float = 1.0
) -> PlotKind:
    return _kind(panel_of_planes(label, [(Role.TRUE, column)], scale), least)


PLOT_KINDS: Sequence[PlotKind] = (
    _kind(PITCH, (-1.0, 1.0), is_default=True),
    _kind(POSITION, is_default=True),
    _kind(DUTY, (-10.0, 10.0), is_default=True),
    _kind(
        Panel('sonar [cm]', (Curve('distance_m', Role.MEASURED),), scale=100.0),
        (0.0, 50.0),
        is_default=True,
    ),
    _kind(SPEED, (-5.0, 5.0)),
    _of_planes('pitch rate [°/s]', 'pitch_rate_{}_deg_per_s', (-5.0, 5.0)),
    _kind(
        panel_of_planes(
            'gyro [°/s]',
            [(Role.TRUE, 'gyro_{}_deg_per_s'), (Role.OFFSET, 'estimated_gyro_offset_{}_deg_per_s')],
        )
    ),
    _of_planes('encoder [°]', 'encoder_{}_deg'),
    _of_planes('motor rate [°/s]', 'motor_rate_{}_deg_per_s', (-20.0, 20.0)),
    _of_planes('motor torque [mN·m]', 'motor_torque_{}_n_m', (-10.0, 10.0), 1000.0),
    _kind(STICKS, (-10.0, 10.0)),
    _kind(BATTERY),
)
"""The plots in the order of the page."""


CHOOSER = 'Choose plots'
_HEIGHT = 130
_SYNC = 'plots'
"""Plots with this key share cursor and zoom."""

_CURSOR = uplot.Cursor(
    y=False,
    sync=uplot.Cursor_Sync(key=_SYNC, scales=('x', None)),
    drag=uplot.Cursor_Drag(x=True, y=False),
)


class Plots:
    """The chosen plots, in the order of `kinds`; they are chosen in the folder `chooser`."""

    def __init__(self, gui: viser.GuiApi, kinds: Sequence[PlotKind]) -> None:
        self._gui = gui
        self._shown: dict[PlotKind, _Plot] = {}
        self._folder = gui.add_folder('Plots', order=20.0)
        self.chooser = gui.add_folder(CHOOSER, order=21.0, expand_by_default=False)
        self._choices: Mapping[PlotKind, Any] = {}
        with self.chooser:
            self.offer({kind.label: kind for kind in kinds})

    def offer(self, kinds: Mapping[str, PlotKind]) -> None:
        """Add further plots to choose from, by label, in the current folder of the page."""
        choices = {
            kind: self._gui.add_checkbox(label, kind.is_default) for label, kind in kinds.items()
        }
        # Not in place: another thread may be showing the chosen plots.
        self._choices = {**self._choices, **choices}

    def update(self, source: Callable[[PlotKind], PlotData]) -> None:
        """Add plots that were chosen, with what `source` returns, and remove the others."""
        for kind in self._chosen():
            if kind not in self._shown:
                self._show(kind, source(kind))

    def refresh(self, source: Callable[[PlotKind], PlotData]) -> None:
        """Show the newest values, which `source` returns, in all chosen plots."""
        for kind in self._chosen():
            self._show(kind, source(kind))

    def _chosen(self) -> list[PlotKind]:
        """Return the chosen plots, after the removal of those that no longer are."""
        chosen = [kind for kind, choice in self._choices.items() if choice.value]
        for kind in self._shown.keys() - set(chosen):
            self._shown.pop(kind).remove()
        return chosen

    def _show(self, kind: PlotKind, data: PlotData) -> None:
        plot = self._shown.get(kind)
        if plot is not None and plot.curves == data.curves:
            plot.show(data)
            return
        if plot is not None:
            self._shown.pop(kind).remove()
        if data.curves:
            with self._folder:
                order = list(self._choices).index(kind)
                self._shown[kind] = _Plot(self._gui, kind, data, order)


class _Plot:
    """A plot with a fixed set of curves."""

    def __init__(self, gui: viser.GuiApi, kind: PlotKind, data: PlotData, order: int) -> None:
        self.curves = data.curves
        self._handle = gui.add_uplot(
            (np.zeros(2),) * (1 + len(data.curves)),
            (uplot.Series(label='t [s]'), *map(_series, data.curves)),
            title=kind.label,
            scales={'x': uplot.Scale(time=False), 'y': _vertical_scale(kind.least)},
            axes=(uplot.Axis(size=26), uplot.Axis(size=46, space=18)),
            legend=uplot.Legend(show=True),
            cursor=_CURSOR,
            height=_HEIGHT,
            padding=(8, 12, 0, 0),
            order=order,
        )
        self.remove = self._handle.remove
        self.show(data)

    def show(self, data: PlotData) -> None:
        """Show other values of the same curves."""
        # Not by the handle's property, which would turn gaps into NaN.
        self._handle._queue_update('data', (data.time, *map(_with_gaps, data.values)))


def _with_gaps(values: Floats) -> Floats | list[float | None]:
    """Return values for uPlot, in which None is a gap and NaN spoils the range of the axis."""
    known = np.isfinite(values)
    if known.all():
        return values
    return [
        value if is_known else None for value, is_known in zip(values.tolist(), known, strict=True)
    ]


def _series(curve: PlotCurve) -> uplot.Series:
    return uplot.Series(
        label=curve.label, stroke=curve.colour, width=curve.width, dash=curve.dash,
        points={} if curve.has_points else {'show': False},
    )  # fmt: skip


def _vertical_scale(least: tuple[float, float] | None) -> uplot.Scale:
    """Return a scale that fits the visible values, and shows at least an interval."""
    if least is None:
        return uplot.Scale()
    low, high = ({'pad': 0.1, 'soft': soft, 'mode': 1} for soft in least)
    return uplot.Scale(range={'min': low, 'max': high})


MAX_ROWS = 200_000
"""Maximum number of ticks that a plot shows one by one; they are sent once, and zoom in a browser
does not ask for more."""


def recorded_kinds(runs: Sequence[PlaybackRun]) -> list[PlotKind]:
    """Return the plots for which any of the runs has signals."""
    return offered_kinds(frozenset().union(*(run.columns for run in runs)))


def recorded_plot(kind: PlotKind, runs: Sequence[PlaybackRun]) -> PlotData:
    """Return the whole curves of a run, and those of a second one as its ghost."""
    ticks = max(run.ticks for run in runs)
    return whole_plot(
        kind,
        np.asarray(TICK_S * np.arange(ticks), float),
        [run.table(kind.columns, ticks) for run in runs],
    )


def whole_plot(kind: PlotKind, time: Floats, tables: Sequence[Mapping[str, Floats]]) -> PlotData:
    """Return the curves of a run's columns, and those of a second run as its ghost."""
    table = dict(tables[0])
    for columns in tables[1:]:
        table |= ghost_columns(columns)
        kind = kind.with_ghost()
    reduced = dict(envelope(time, table, MAX_ROWS))
    return plot_data(kind, reduced.pop('time_s'), reduced)
