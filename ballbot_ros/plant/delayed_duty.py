"""The dead time of the motors: the duty that acts is an earlier one."""

from __future__ import annotations

from collections import deque
from typing import NamedTuple

from ballbot_ros.brick.dead_time import DeadTime, newest_effective
from ballbot_ros.timing import STEP_NS, STEPS_PER_TICK


class DutyState(NamedTuple):
    """The newest duties [%], the newest first, and when each takes effect [ns]."""

    effects_ns: tuple[int, ...]
    duties: tuple[tuple[int, int], ...]


class DelayedDuty:
    """The duty that acts: the newest one whose dead time is over; none before the first."""

    def __init__(self, dead_time: DeadTime) -> None:
        self._dead_time = dead_time
        # The dead time of the last of these is over at any time.
        self._count = -(-dead_time.longest // STEPS_PER_TICK) + 1
        self.restore_state(DutyState((), ()))

    def command(self, duty: tuple[int, int], now_ns: int) -> None:
        """Add the duty of the tick at `now_ns` [ns]."""
        self._effects_ns.appendleft(now_ns + self._dead_time.delay(now_ns) * STEP_NS)
        self._duties.appendleft(duty)

    def at(self, now_ns: int) -> tuple[int, int]:
        """Return the duty that acts in the step that begins at a sim time [ns]."""
        number = newest_effective(self._effects_ns, now_ns)
        return self._duties[number] if number >= 0 else (0, 0)

    def save_state(self) -> DutyState:
        """Return the present state."""
        return DutyState(tuple(self._effects_ns), tuple(self._duties))

    def restore_state(self, state: DutyState) -> None:
        """Continue from a state of motors with the same dead time."""
        self._effects_ns = deque(state.effects_ns, self._count)
        self._duties = deque(state.duties, self._count)
