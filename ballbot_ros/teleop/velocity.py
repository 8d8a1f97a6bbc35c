"""Mapping of a velocity to the two sticks."""

from __future__ import annotations

import math
from dataclasses import dataclass

from ballbot_ros.parameters import Subset
from ballbot_ros.teleop.errors import TeleopError
from ballbot_ros.teleop.sticks import NEUTRAL, Sticks, sticks_of


@dataclass(frozen=True)
class VelocityMapping(Subset):
    """The inverse of the controller's mapping from sticks to speed.

    The ball's rate at a full stick (`gp_max`) is `k_thetadot` [deg/s]; its radius is Rs [m].
    """

    k_thetadot: float
    ball_radius: float
    gp_max: int

    @property
    def full_speed(self) -> float:
        """Speed at a full stick [m/s]."""
        return math.radians(self.k_thetadot) * self.ball_radius

    def sticks(self, forward: float, left: float) -> Sticks:
        """Return the sticks for a velocity [m/s] in the axes of REP 103.

        A velocity beyond the full stick is scaled down in both planes, which keeps its direction.

        Raises
        ------
        TeleopError
            If a component is not finite.
        """
        for name, value in (('linear.x', forward), ('linear.y', left)):
            if not math.isfinite(value):
                raise TeleopError(f'{name} is {value:g}, not a finite number')
        full = max(self.full_speed, abs(forward), abs(left))
        if not full or not self.full_speed:
            return NEUTRAL
        return sticks_of(forward / full, -left / full, self.gp_max)
