"""Metrics of many runs, by the functions that measure one."""

from __future__ import annotations

import math
from typing import Any

from ballbot_ros.analysis.metrics import measured_window
from ballbot_ros.engine.scenario.metrics import Motion


def metric(motion: Motion) -> float:
    """Stand for the metric that the compiler puts in its place."""
    raise NotImplementedError


def measure_runs(
    plants: Any,
    starts: Any,
    ends: Any,
    log: Any,
    time: Any,
    walls: Any,
    window_start: float,
    window_end: float,
    values: Any,
) -> None:
    """Measure a metric in a window of many runs; NaN if no tick is in the window.

    Parameters
    ----------
    plants : rows
        The parameters of ``plant_sim``.
    starts : ndarray, shape (r, 2)
        Start positions [m].
    ends : rows of robots
        How the runs ended.
    log : RunLog
        The runs.
    time : ndarray, shape (n,)
        Time of each tick since the first [s].
    walls : Walls
        As in :class:`~ballbot_ros.engine.scenario.metrics.Motion`.
    window_start, window_end : float
        The measured window [s].
    values : ndarray, shape (r,)
        Where the values are written.
    """
    for run in range(len(plants)):
        first, last = measured_window(
            time[: ends[run].ticks], plants[run].hold_time, window_start, window_end
        )
        if first >= last:
            values[run] = math.nan
            continue
        values[run] = metric(
            Motion(
                time[first:last],
                log.position[run, first:last],
                log.psi[run, first:last],
                log.duty[run, first:last],
                starts[run],
                walls,
            )
        )
