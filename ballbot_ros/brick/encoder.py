"""The rotary encoders of motors B (plane x) and C (plane y)."""

from __future__ import annotations

from ballbot_ros.brick.units import degrees_of, quantise

INT32_MIN, INT32_MAX = -(2**31), 2**31 - 1


def encoder_reading(angle: float) -> int:
    """Return the whole degrees of a shaft angle [rad]; a counter has 32 bits, and stops there."""
    return quantise(max(float(INT32_MIN), min(float(INT32_MAX), degrees_of(angle))))


class Encoder:
    """Whole degrees of the motor shafts since the start pose, where the counters are zeroed."""

    def read(self, angles: tuple[float, float], stamp_ns: int) -> tuple[int, int]:
        """Return the counts [deg] for the shaft angles [rad] of planes x and y at any stamp."""
        return encoder_reading(angles[0]), encoder_reading(angles[1])
