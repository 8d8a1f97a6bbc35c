"""The rotary encoders of motors B (plane x) and C (plane y)."""

from __future__ import annotations

from ballbot_ros.brick.units import degrees_of


class Encoder:
    """Whole degrees of the motor shafts since the start pose, where the counters are zeroed."""

    def read(self, angles: tuple[float, float], stamp_ns: int) -> tuple[int, int]:
        """Return the counts [deg] for the shaft angles [rad] of planes x and y, at any time."""
        return degrees_of(angles[0]), degrees_of(angles[1])
