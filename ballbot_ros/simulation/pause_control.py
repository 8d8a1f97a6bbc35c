"""Pause and single step."""

from __future__ import annotations


class PauseControl:
    """Pauses the plant and allows single steps."""

    def __init__(self) -> None:
        self.is_paused = False
        self._steps = 0

    def set(self, *, is_paused: bool) -> None:
        """Pause or resume."""
        self.is_paused = is_paused
        if not is_paused:
            self._steps = 0

    def step(self) -> bool:
        """Allow one more tick; return whether the plant is paused, which a step requires."""
        self._steps += self.is_paused
        return self.is_paused

    def take_step(self) -> bool:
        """Return whether the plant may advance by a tick, and consume a step."""
        if self.is_paused and self._steps == 0:
            return False
        self._steps -= self.is_paused
        return True
