"""New parameter values of a running controller, without a jump of the duty."""

from __future__ import annotations

from ballbot_ros.parameters import ControllerParameters, Value

GLIDE_TICKS = 125
"""Ticks in which a number reaches a new value: 0.5 s."""


class Glide:
    """Moves the real numbers among the parameters to new values, in equal steps of a tick each.

    A duty that depends on them moves as smoothly, whatever the errors are, and at the end nothing
    of the old values remains. Whole numbers, switches and texts have their new values at once.

    Attributes
    ----------
    parameters : ControllerParameters
        The values in effect.
    is_moving : bool
        Whether some of them are still on the way.
    """

    def __init__(self, parameters: ControllerParameters) -> None:
        self.parameters = self._start = self._target = parameters
        self.is_moving = False
        self._ticks = 0

    def move_to(self, parameters: ControllerParameters) -> None:
        """Begin to move to other values, from those in effect."""
        self._start, self._target = self.parameters, parameters
        self._ticks = 0
        self.is_moving = True

    def tick(self) -> ControllerParameters:
        """Return the values of the next tick."""
        self._ticks += 1
        if self._ticks < GLIDE_TICKS:
            start, share = self._start.values(), self._ticks / GLIDE_TICKS
            self.parameters = self._target.with_values(
                {
                    name: _between(start[name], value, share)
                    for name, value in self._target.values().items()
                    if value != start[name]
                }
            )
        else:
            self.parameters = self._target
        self.is_moving = self.parameters != self._target
        return self.parameters


def _between(start: Value, end: Value, share: float) -> Value:
    """Return a share of the way from one real number, or several, to others; else the end."""
    if isinstance(start, tuple) and isinstance(end, tuple):
        return tuple(a + share * (b - a) for a, b in zip(start, end, strict=True))
    if isinstance(start, float) and isinstance(end, float):
        return start + share * (end - start)
    return end
