"""Figures of a run, in one house style."""

from __future__ import annotations

from io import BytesIO
from pathlib import Path

import numpy as np

from ballbot_ros.simulation.trajectory import Trajectory

# Okabe and Ito's colours: told apart by the colour-blind, and by their lightness in print.
BLUE, ORANGE, GRAY = '#0072B2', '#D55E00', '#666666'


def draw_motion(trajectory: Trajectory, path: Path, title: str, hold_time: float) -> None:
    """Draw position and body pitch against time, like the document's figure 8-2.

    Parameters
    ----------
    trajectory : Trajectory
    path : Path
        The PNG to write.
    title : str
        Heading.
    hold_time : float
        End of the gyro calibration [s], marked where it is within the run.
    """
    # Here, not above: the import takes a second that no run should wait for at its start.
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8.0, 6.0), layout='constrained')
    position_axes, pitch_axes, duty_axes = figure.subplots(
        3, 1, sharex=True, height_ratios=(3, 3, 2)
    )
    figure.suptitle(title)
    time = trajectory.time
    for axes, values, label in (
        (position_axes, trajectory.position * 100.0, 'position [cm]'),
        (pitch_axes, np.degrees(trajectory.psi), 'body pitch [°]'),
        (duty_axes, trajectory.duty, 'duty [%]'),
    ):
        axes.margins(x=0.0)
        axes.plot(time, values[:, 1], color=ORANGE, linewidth=1.0, linestyle='--', label='plane y')
        axes.plot(time, values[:, 0], color=BLUE, linewidth=1.4, label='plane x')
        axes.set_ylabel(label)
        axes.grid(alpha=0.3)
        axes.spines[['top', 'right']].set_visible(False)
        if len(time) and 0.0 < hold_time < time[-1]:
            axes.axvline(hold_time, color=GRAY, linewidth=0.8, linestyle=':')
    position_axes.legend(loc='upper right', ncols=2, frameon=False)
    if len(time) and 0.0 < hold_time < time[-1]:
        position_axes.annotate(
            'gyro calibration ends', (hold_time, 0.0), (4, 3), color=GRAY, fontsize='small',
            xycoords=('data', 'axes fraction'), textcoords='offset points', va='bottom',
        )  # fmt: skip
    duty_axes.set_xlabel('time [s]')
    # By way of memory: a full disk then ends in one error, not in a half-written picture.
    buffer = BytesIO()
    figure.savefig(buffer, dpi=150)
    path.write_bytes(buffer.getvalue())
