"""Sticks from the keys of a terminal, which does not report key releases."""

from __future__ import annotations

import math

from ballbot_ros.brick.units import quantise
from ballbot_ros.teleop.sticks import Sticks

HELD_S = 0.5
"""Time for which a key counts as held after its last repetition."""

SPEED_STEP_PERCENT = 10

_ARROWS = {'up': (0, -1), 'down': (0, 1), 'left': (1, -1), 'right': (1, 1)}
"""The stick that each arrow moves, and its sign."""


class KeyboardSticks:
    """The sticks that the arrow keys move, by `speed_percent` of a full stick (``gp_max``).

    Arrows for different sticks combine to a diagonal while both count as held. All times are from
    one monotonic clock [s].
    """

    def __init__(self, full: int) -> None:
        self.full = full
        self.speed_percent = 50
        self._signs = [0, 0]
        self._until = [-math.inf, -math.inf]

    @property
    def holds(self) -> bool:
        """Whether the current direction is held without a key."""
        return math.inf in self._until

    def arrow(self, name: str, now_s: float) -> None:
        """Process an arrow key: ``up``, ``down``, ``left`` or ``right``."""
        if self.holds:
            self.stop()
        stick, sign = _ARROWS[name]
        self._signs[stick], self._until[stick] = sign, now_s + HELD_S

    def hold(self, now_s: float) -> None:
        """Hold the current direction until the next arrow or :meth:`stop`."""
        self._until = [math.inf if now_s <= until else until for until in self._until]

    def stop(self) -> None:
        """Return the sticks to neutral."""
        self._signs = [0, 0]
        self._until = [-math.inf, -math.inf]

    def change_speed(self, steps: int) -> None:
        """Change the share of the full stick for a key by `steps`, within one step ... full."""
        speed = self.speed_percent + steps * SPEED_STEP_PERCENT
        self.speed_percent = min(100, max(SPEED_STEP_PERCENT, speed))

    def sticks(self, now_s: float) -> Sticks:
        """Return the sticks at `now_s`."""
        value = quantise(self.full * self.speed_percent / 100)
        vertical, horizontal = (
            sign * value if now_s <= until else 0
            for sign, until in zip(self._signs, self._until, strict=True)
        )
        return vertical, horizontal
