"""The state of the robot at one instant, and its recent history."""

from __future__ import annotations

import math
from collections import deque
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ballbot_ros.plant.ground_truth import Pair
from ballbot_ros.viewer.robot import TRAIL_STEP

WINDOW_S = 10.0
"""Length of the plots in time."""

TRACE_COLUMNS = 8

TRAIL_POINTS = 2000
"""Maximum number of points of the trail."""


class Snapshot(NamedTuple):
    """The robot at one instant; pairs are (plane x, plane y), as in docs/frames.md.

    Attributes
    ----------
    time : float
        Sim time, or time since the start of a recorded run [s].
    position, psi, duty : tuple of float
        Ball centre [m], body pitch [rad] and motor duty [%].
    sonar, cone_angle : float
        Distance [m], inf without an echo, NaN without data; opening of the sonar's cone [rad].
    battery : float
        Voltage [V]; NaN if unknown.
    state : str
        Operating state; empty if unknown.
    lcd : str
        The display's lines.
    ball : tuple of float or None
        Orientation of the ball as a quaternion w, x, y, z; None if only the shown positions
        determine it.
    """

    time: float
    position: Pair
    psi: Pair
    duty: Pair = (math.nan, math.nan)
    sonar: float = math.nan
    cone_angle: float = 0.0
    battery: float = math.nan
    state: str = ''
    lcd: str = ''
    ball: tuple[float, float, float, float] | None = None


class History:
    """The samples of the last :data:`WINDOW_S` of sim time, and the trail of the ball."""

    def __init__(self) -> None:
        self._rows: deque[tuple[float, ...]] = deque()
        self._trail: deque[tuple[float, float]] = deque(maxlen=TRAIL_POINTS)

    def clear(self) -> None:
        """Start over with a new run."""
        self._rows.clear()
        self._trail.clear()

    def add(self, snapshot: Snapshot) -> None:
        """Add a sample, unless there is one with the same time.

        A sample with an earlier time restarts the history: a player has jumped back.
        """
        if self._rows and snapshot.time == self._rows[-1][0]:
            return
        if self._rows and snapshot.time < self._rows[-1][0]:
            self.clear()
        self._rows.append(
            (snapshot.time, *snapshot.psi, *snapshot.position, *snapshot.duty, snapshot.sonar)
        )
        while self._rows[0][0] < snapshot.time - WINDOW_S:
            self._rows.popleft()
        point = snapshot.position[0], -snapshot.position[1]
        if not self._trail or math.dist(point, self._trail[-1]) > TRAIL_STEP:
            self._trail.append(point)

    def trail(self) -> list[tuple[float, float]]:
        """Return the trail, x and y in ``map`` [m]."""
        return list(self._trail)

    def trace(self) -> NDArray[np.float64]:
        """Return time [s], ψ x, y [rad], position x, y [m], duty x, y [%], sonar [m]; (n, 8)."""
        return np.array(self._rows, np.float64).reshape(-1, TRACE_COLUMNS)
