"""The rotary encoders of motors B (plane x) and C (plane y), which are zeroed in the start pose."""

from __future__ import annotations

from ballbot_ros.brick.units import degrees_of, quantise

INT32_MIN, INT32_MAX = -(2**31), 2**31 - 1


def encoder_reading(angle: float) -> int:
    """Return the whole degrees of a shaft angle [rad]; a counter has 32 bits, and stops there."""
    return quantise(max(float(INT32_MIN), min(float(INT32_MAX), degrees_of(angle))))
