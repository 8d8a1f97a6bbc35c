"""The dead time of the motors: the duty that acts is an earlier one."""

from __future__ import annotations

from collections import deque
from typing import NamedTuple

from ballbot_ros.brick.dead_time import DeadTime
from ballbot_ros.timing import STEP_NS


class PendingDuty(NamedTuple):
    """Duties of planes x and y [%] that act from a sim time [ns] on."""

    effect_ns: int
    duty: tuple[int, int]


class DutyState(NamedTuple):
    """The duty that acts, and those that will, in the order of their effects."""

    acting: tuple[int, int]
    pending: tuple[PendingDuty, ...]


class DelayedDuty:
    """The duty that acts: the newest one whose dead time is over, none before the first."""

    def __init__(self, dead_time: DeadTime) -> None:
        self._dead_time = dead_time
        self._acting = (0, 0)
        self._pending: deque[PendingDuty] = deque()

    def command(self, duty: tuple[int, int], now_ns: int) -> None:
        """Add the duty of a tick [ns]; it supersedes those that would take effect no earlier."""
        effect_ns = now_ns + self._dead_time.delay(now_ns) * STEP_NS
        while self._pending and self._pending[-1].effect_ns >= effect_ns:
            self._pending.pop()
        self._pending.append(PendingDuty(effect_ns, duty))

    def at(self, now_ns: int) -> tuple[int, int]:
        """Return the duty that acts in the step that begins at a sim time [ns]."""
        while self._pending and self._pending[0].effect_ns <= now_ns:
            self._acting = self._pending.popleft().duty
        return self._acting

    def save_state(self) -> DutyState:
        """Return the present state."""
        return DutyState(self._acting, tuple(self._pending))

    def restore_state(self, state: DutyState) -> None:
        """Continue from a state of motors with the same dead time."""
        self._acting, self._pending = state.acting, deque(state.pending)
