"""Pause and single step."""

from __future__ import annotations


class PauseControl:
    """Pauses the plant and allows single steps.

    Attributes
    ----------
    awaits_start : bool
        Whether it has been paused since the beginning, and nobody has decided otherwise.
    """

    def __init__(self, *, starts_paused: bool = False) -> None:
        self.is_paused = self.awaits_start = starts_paused
        self._steps = 0

    def set(self, *, is_paused: bool) -> None:
        """Pause or resume."""
        self.is_paused = is_paused
        self.awaits_start = False
        if not is_paused:
            self._steps = 0

    def start(self) -> bool:
        """End the pause at the start; return whether there was one."""
        if not self.awaits_start:
            return False
        self.set(is_paused=False)
        return True

    def step(self) -> bool:
        """Allow one more tick; return whether the plant is paused, which a step requires."""
        self.awaits_start = False
        self._steps += self.is_paused
        return self.is_paused

    def take_step(self) -> bool:
        """Return whether the plant may advance by a tick, and consume a step."""
        if self.is_paused and self._steps == 0:
            return False
        self._steps -= self.is_paused
        return True
