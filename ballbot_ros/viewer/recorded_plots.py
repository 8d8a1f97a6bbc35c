"""The plots of recorded runs."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ballbot_ros.analysis.table import envelope
from ballbot_ros.timing import TICK_S
from ballbot_ros.viewer.playback_run import PlaybackRun
from ballbot_ros.viewer.plot_kinds import (
    PlotData,
    PlotKind,
    ghost_columns,
    offered_kinds,
    plot_data,
)

MAX_ROWS = 200_000
"""Maximum number of ticks that a plot shows one by one; they are sent once, and zoom in a browser
does not ask for more."""


def recorded_kinds(runs: Sequence[PlaybackRun]) -> list[PlotKind]:
    """Return the plots for which any of the runs has signals."""
    return offered_kinds(frozenset().union(*(run.columns for run in runs)))


def recorded_plot(kind: PlotKind, runs: Sequence[PlaybackRun]) -> PlotData:
    """Return the whole curves of a run, and those of a second one as its ghost."""
    ticks = max(run.ticks for run in runs)
    table = runs[0].table(kind.columns, ticks)
    for ghost in runs[1:]:
        table |= ghost_columns(ghost.table(kind.columns, ticks))
        kind = kind.with_ghost()
    reduced = dict(envelope(TICK_S * np.arange(ticks), table, MAX_ROWS))
    return plot_data(kind, reduced.pop('time_s'), reduced)
