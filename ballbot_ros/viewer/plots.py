"""The plots in the panel, with one time axis, zoom and cursor for all."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import viser
from viser import uplot

from ballbot_ros.viewer.plot_kinds import Curve, Floats, PlotData, PlotKind

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
    """The chosen plots, in the order of `kinds`.

    Attributes
    ----------
    chooser : viser.GuiFolderHandle
        The folder in which they are chosen.
    """

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


def _series(curve: Curve) -> uplot.Series:
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
