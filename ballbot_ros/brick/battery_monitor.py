"""The brick's battery voltage measurement."""

from __future__ import annotations

from ballbot_ros.brick.units import quantise

STEP_MV = 13.85


def battery_mv(voltage: float) -> int:
    """Return the reading [mV] for a voltage [V]: a whole number of 13.85 mV steps, rounded."""
    steps = quantise(voltage * 1000.0 / STEP_MV)
    return max(0, min(65535, quantise(steps * STEP_MV)))
