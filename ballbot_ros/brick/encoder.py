"""The rotary encoders of motors B (plane x) and C (plane y)."""

from __future__ import annotations

from ballbot_ros.brick.units import radians_to_degrees


class Encoder:
    """Whole degrees of the motor shafts since the start pose, where the counters are zeroed."""

    def read(self, angles: tuple[float, float], stamp_ns: int) -> tuple[int, int]:
        """Return the counts [deg] for the shaft angles [rad] of planes x and y at any stamp."""
        return radians_to_degrees(angles[0]), radians_to_degrees(angles[1])
