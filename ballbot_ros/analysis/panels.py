"""The quantities of a run against time: the signals of each, and the unit in which it is shown."""

from __future__ import annotations

import numpy as np

from ballbot_ros.analysis.figure_parts import Curve, Panel, Role, panel_of_planes, plane_columns
from ballbot_ros.engine.rows import Column
from ballbot_ros.engine.trajectory import Trajectory

PITCH = panel_of_planes(
    'body pitch [°]',
    [(Role.TRUE, 'pitch_{}_deg'), (Role.ESTIMATED, 'estimated_pitch_{}_deg')],
)
POSITION = panel_of_planes(
    'position [cm]',
    [
        (Role.TRUE, 'position_{}_m'),
        (Role.REFERENCE, 'reference_position_{}_m'),
        (Role.ESTIMATED, 'estimated_position_{}_m'),
    ],
    scale=100.0,
)
SPEED = panel_of_planes(
    'speed [cm/s]',
    [
        (Role.TRUE, 'speed_{}_m_per_s'),
        (Role.COMMANDED, 'commanded_speed_{}_m_per_s'),
        (Role.REFERENCE, 'reference_speed_{}_m_per_s'),
    ],
    scale=100.0,
)
DUTY = panel_of_planes('duty [%]', [(Role.TRUE, 'duty_{}_percent')])
STICKS = panel_of_planes('sticks [%]', [(Role.TRUE, 'stick_{}_percent')])
BATTERY = Panel('battery [V]', (Curve('battery_v', Role.MEASURED),), min_span=0.5)

TRUE_POSITION, TRUE_PITCH = (each.only(Role.TRUE) for each in (POSITION, PITCH))


def motion_columns(trajectory: Trajectory) -> dict[str, Column]:
    """Return position [m], pitch [°] and duty [%] by the names of their signals' columns."""
    return {
        **plane_columns('position', 'm', trajectory.position),
        **plane_columns('pitch', 'deg', np.degrees(trajectory.psi)),
        **plane_columns('duty', 'percent', trajectory.duty),
    }
