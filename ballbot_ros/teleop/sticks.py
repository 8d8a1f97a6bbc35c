"""The two sticks in the units of the gamepad packet."""

from __future__ import annotations

from ballbot_ros.brick.units import quantise

Sticks = tuple[int, int]
"""Left stick vertical (up, forward, is negative) and right stick horizontal (right is positive)."""

NEUTRAL: Sticks = (0, 0)


def sticks_of(forward: float, rightward: float, full: int) -> Sticks:
    """Return the sticks for shares of the full speed, -1 ... 1, and a full stick (``gp_max``)."""
    return -quantise(forward * full), quantise(rightward * full)
