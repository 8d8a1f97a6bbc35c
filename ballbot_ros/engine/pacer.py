"""The pace of a run: against the wall clock, paused, or tick by tick."""

from __future__ import annotations

from ballbot_ros.parameters.timing import TICK_S


class Pacer:
    """Computes when each tick is due on the wall clock.

    Times are readings of one monotonic clock [s]. A tick that comes more than a period late is
    counted (`late_ticks`); pacing then restarts instead of catching up.
    """

    def __init__(self) -> None:
        self.late_ticks = 0
        self.restart()

    def restart(self) -> None:
        """Restart the pacing with the next tick."""
        self._due_s: float | None = None

    def delay_s(self, factor: float, now_s: float) -> float:
        """Return how long to wait before the next tick at `factor` times real time [s].

        The result is 0 if the tick is due, and always for a factor of 0.
        """
        if factor == 0.0 or self._due_s is None:
            return 0.0
        return max(0.0, self._due_s - now_s)

    def on_tick(self, factor: float, now_s: float) -> None:
        """Note a tick at `now_s`; the next one is due a period later."""
        if factor == 0.0:
            self._due_s = None
            return
        period_s = TICK_S / factor
        due_s = now_s if self._due_s is None else self._due_s
        if now_s - due_s > period_s:
            self.late_ticks += 1
            due_s = now_s
        self._due_s = due_s + period_s


class PauseControl:
    """Pauses the plant and allows single steps.

    It `awaits_start` if it has been paused since the beginning, and nobody has decided otherwise.
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
