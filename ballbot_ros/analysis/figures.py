"""The figure of a run: its motion against time, and its track."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ballbot_ros.analysis.drawing import (
    DUTY,
    PITCH,
    POSITION,
    draw_floor,
    draw_planes,
    draw_track,
    label_time,
    legend_above,
    legend_below,
    name_intervals,
    shade_intervals,
)
from ballbot_ros.analysis.interval import Interval, IntervalKind
from ballbot_ros.analysis.style import BLUE, WIDTH, Line, new_figure
from ballbot_ros.analysis.table import track_columns
from ballbot_ros.engine.scenario.scenario import Segment
from ballbot_ros.engine.trajectory import Trajectory
from ballbot_ros.robot.world.exports import OccupancyGrid
from ballbot_ros.robot.world.floor_map import FloorMap

if TYPE_CHECKING:
    from matplotlib.figure import Figure, SubFigure

MIN_TRACK_RANGE_CM = 5.0
"""Range of the motion in plane y above which the picture shows the track, too."""


def draw_motion(
    trajectory: Trajectory,
    title: str,
    hold_time: float,
    segments: Iterable[Segment] = (),
    floor: FloorMap | OccupancyGrid | None = None,
    marked: Iterable[Interval] = (),
) -> Figure:
    """Draw position, body pitch and duty against time, like the document's figures 8-2 and 8-3.

    With a map, or if the ball moves in both planes, the track is drawn next to them. The gyro
    calibration, up to `hold_time` [s], is shaded, and so are the segments of the sticks and the
    `marked` intervals, such as pushes; all are named where there is room.
    """
    position = trajectory.position
    with_track = len(position) > 0 and (
        floor is not None or np.ptp(position[:, 1]) * 100.0 > MIN_TRACK_RANGE_CM
    )
    figure = new_figure(12.0 if with_track else WIDTH, 6.0, title)
    history: Figure | SubFigure = figure
    if with_track:
        history, beside = np.asarray(figure.subfigures(1, 2, width_ratios=(8, 5)))
        track = beside.subplots()
        draw_floor(track, floor)
        draw_track(track, track_columns(position), Line(BLUE))
        legend_above(track)
    _draw_history(history, trajectory, _intervals(trajectory, hold_time, segments, marked))
    return figure


def _intervals(
    trajectory: Trajectory,
    hold_time: float,
    segments: Iterable[Segment],
    marked: Iterable[Interval],
) -> list[Interval]:
    """Return the intervals to shade, within the recorded ticks."""
    last = float(trajectory.time[-1]) if len(trajectory.time) else 0.0
    intervals = [Interval(0.0, hold_time, 'calibration')]
    intervals += marked
    intervals += [
        Interval(each.start, each.end, each.name, IntervalKind.STICKS) for each in segments
    ]
    return [
        replace(each, end=min(each.end, last))
        for each in intervals
        if each.start < min(each.end, last)
    ]


def _draw_history(
    figure: Figure | SubFigure, trajectory: Trajectory, intervals: Sequence[Interval]
) -> None:
    rows = figure.subplots(3, 1, sharex=True, height_ratios=(3, 3, 2))
    table = {
        'time_s': trajectory.time,
        **POSITION.columns(trajectory.position * 100.0),
        **PITCH.columns(np.degrees(trajectory.psi)),
        **DUTY.columns(trajectory.duty),
    }
    for axes, quantity in zip(rows, (POSITION, PITCH, DUTY), strict=True):
        draw_planes(axes, quantity, table)
        shade_intervals(axes, intervals)
    name_intervals(rows[0], intervals)
    label_time(rows[2])
    legend_below(rows[2])
