"""The picture that goes beside a run's recording: its motion against time, and its track."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from ballbot_ros.analysis.style import BLUE, GRAY, ORANGE, PLANES, new_figure, png_of, tidy
from ballbot_ros.scenario.signal import Segment
from ballbot_ros.simulation.trajectory import Trajectory
from ballbot_ros.world.floor_map import LINE, WALL, FloorMap

MANY_CM = 5.0
"""Motion in plane y from which on the track says more than the two positions against time."""


def draw_motion(
    trajectory: Trajectory,
    path: Path,
    title: str,
    hold_time: float,
    segments: Iterable[Segment] = (),
    floor_map: FloorMap | None = None,
) -> None:
    """Draw position, body pitch and duty against time, like the document's figures 8-2 and 8-3.

    Where there is a map, or the ball moves in both planes, its track is drawn beside them.

    Parameters
    ----------
    trajectory : Trajectory
    path : Path
        The PNG to write.
    title : str
        Heading.
    hold_time : float
        End of the gyro calibration [s], shaded from the start.
    segments : iterable of Segment
        Stick segments, shaded and named.
    floor_map : FloorMap or None
        Walls and lines below the track.
    """
    sideways = trajectory.position[:, 1] * 100.0
    with_track = len(sideways) > 0 and (floor_map is not None or np.ptp(sideways) > MANY_CM)
    figure = new_figure(12.0 if with_track else 8.0, 6.0, title)
    history: Any = figure
    if with_track:
        history, beside = np.asarray(figure.subfigures(1, 2, width_ratios=(8, 5)))
        _draw_track(beside.subplots(), trajectory, floor_map)
    _draw_history(
        history.subplots(3, 1, sharex=True, height_ratios=(3, 3, 2)),
        trajectory,
        hold_time,
        segments,
    )
    path.write_bytes(png_of(figure))


def _draw_history(
    rows: Any, trajectory: Trajectory, hold_time: float, segments: Iterable[Segment]
) -> None:
    time = trajectory.time
    last = float(time[-1]) if len(time) else 0.0
    spans = [(segment.start, segment.end, segment.name) for segment in segments]
    spans = [(0.0, hold_time, 'calibration'), *spans]
    spans = [(start, min(end, last), name) for start, end, name in spans if start < min(end, last)]
    for axes, values, label in (
        (rows[0], trajectory.position * 100.0, 'position [cm]'),
        (rows[1], np.degrees(trajectory.psi), 'body pitch [°]'),
        (rows[2], trajectory.duty, 'duty [%]'),
    ):
        axes.margins(x=0.0)
        for plane in (1, 0):
            axes.plot(time, values[:, plane], **PLANES[plane])
        axes.set_ylabel(label)
        tidy(axes)
        for start, end, _ in spans:
            axes.axvspan(start, end, color=GRAY, alpha=0.12, linewidth=0.0)
    for start, end, name in spans:
        rows[0].annotate(
            name, ((start + end) / 2.0, 1.0), (0, 3), color=GRAY, fontsize='small',
            xycoords=('data', 'axes fraction'), textcoords='offset points', ha='center',
        )  # fmt: skip
    rows[2].set_xlabel('time [s]')
    # Beside that label, where no curve is.
    rows[2].legend(
        handles=rows[2].get_lines()[::-1],
        loc='upper right', bbox_to_anchor=(1.0, -0.2), ncols=2, frameon=False,
    )  # fmt: skip


def _draw_track(axes: Any, trajectory: Trajectory, floor_map: FloorMap | None) -> None:
    """Draw the ball's way from above, forward to the right, as in the frame `map`."""
    if floor_map is not None:
        # In a lighter gray than the image has, so that the track stands out.
        shades = {WALL: 0.6, LINE: 0.8}
        picture = np.ones(floor_map.cells.shape)
        for kind, shade in shades.items():
            picture[floor_map.cells == kind] = shade
        columns, rows = floor_map.columns / 2.0, floor_map.rows / 2.0
        axes.imshow(
            picture, cmap='gray', vmin=0.0, vmax=1.0, extent=(-columns, columns, -rows, rows)
        )
    x, y = trajectory.position[:, 0] * 100.0, trajectory.position[:, 1] * -100.0
    axes.plot(x, y, color=BLUE, linewidth=1.4)
    axes.plot(x[0], y[0], marker='o', color=GRAY, linestyle='', label='start')
    axes.plot(x[-1], y[-1], marker='s', color=ORANGE, linestyle='', label='end')
    axes.set_aspect('equal', adjustable='datalim' if floor_map is None else 'box')
    axes.set_xlabel('x of map [cm]')
    axes.set_ylabel('y of map [cm]')
    axes.legend(loc='best', frameon=False)
    tidy(axes)
