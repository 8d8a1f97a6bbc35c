"""Sticks from the keys of a terminal, which tells of keys pressed but never of keys released."""

from __future__ import annotations

import math

from ballbot_ros.brick.units import quantise
from ballbot_ros.teleop.sticks import Sticks

HELD_S = 0.5
"""A key counts as held for so long after it, or its last repetition, came."""

SPEED_STEP_PERCENT = 10

_ARROWS = {'up': (0, -1), 'down': (0, 1), 'left': (1, -1), 'right': (1, 1)}
"""The stick that an arrow moves, and its sign."""


class KeyboardSticks:
    """The state of the keys.

    Arrows of different sticks add up to a diagonal while both count as held. All times are of one
    clock that never goes back [s].

    Parameters
    ----------
    full : int
        Value of a full stick (``gp_max``).

    Attributes
    ----------
    full : int
    speed_percent : int
        Share of the full stick that a key gives.
    """

    def __init__(self, full: int) -> None:
        self.full = full
        self.speed_percent = 50
        self._signs = [0, 0]
        self._until = [-math.inf, -math.inf]

    @property
    def holds(self) -> bool:
        """Whether the present direction stays without a key."""
        return math.inf in self._until

    def arrow(self, name: str, now: float) -> None:
        """Take an arrow: ``up``, ``down``, ``left`` or ``right``."""
        if self.holds:
            self.stop()
        stick, sign = _ARROWS[name]
        self._signs[stick], self._until[stick] = sign, now + HELD_S

    def hold(self, now: float) -> None:
        """Keep the present direction until the next arrow or :meth:`stop`."""
        self._until = [math.inf if now <= until else until for until in self._until]

    def stop(self) -> None:
        """Let the sticks go to neutral."""
        self._signs = [0, 0]
        self._until = [-math.inf, -math.inf]

    def change_speed(self, steps: int) -> None:
        """Change the share that a key gives, within one step and full."""
        speed = self.speed_percent + steps * SPEED_STEP_PERCENT
        self.speed_percent = min(100, max(SPEED_STEP_PERCENT, speed))

    def sticks(self, now: float) -> Sticks:
        """Return the sticks at `now`."""
        value = quantise(self.full * self.speed_percent / 100)
        vertical, horizontal = (
            sign * value if now <= until else 0
            for sign, until in zip(self._signs, self._until, strict=True)
        )
        return vertical, horizontal
