"""Who is in command: of several inputs, the one whose sticks go to the robot."""

from __future__ import annotations

from threading import Lock
from typing import NamedTuple

from ballbot_ros.teleop.sticks import NEUTRAL, Sticks

LIVE_SOURCES = DEVICE, JOY, VIEWER, KEYBOARD, CMD_VEL = (
    'device',
    'joy',
    'viewer',
    'keyboard',
    'cmd_vel',
)
"""The live inputs, the one with the highest priority first."""

SCENARIO = 'scenario'
"""What acts while no live input is in command."""

NOBODY = 'nobody'
"""Who is in command, to the eye, without live input and without a scenario."""

SILENCE_S = 0.5
"""A source that has said nothing for longer than this counts as neutral."""

PAUSE_S = 0.5
"""The sticks are neutral for so long before a source of lower priority takes over."""

_RANK = {source: rank for rank, source in enumerate((*LIVE_SOURCES, SCENARIO))}


class Command(NamedTuple):
    """The source in command, and the sticks that go to the robot."""

    source: str
    sticks: Sticks

    def driver(self, scenario: str) -> str:
        """Return the name to show of who is in command; `scenario` is '' where there is none."""
        return self.source if self.source != SCENARIO or scenario else NOBODY


class Arbiter:
    """Keeps the newest sticks of each source and decides between them.

    Of the live sources the one of highest priority whose sticks are not neutral is in command. When
    it goes neutral, is released or falls silent, the sticks are neutral at once; it, or a source of
    higher priority, may go on at any moment, one of lower priority after :data:`PAUSE_S`. Sources
    may report from any thread. All times are of one clock that never goes back [s].
    """

    def __init__(self) -> None:
        self._lock = Lock()
        self._reports: dict[str, tuple[Sticks, float]] = {}
        self._in_command = SCENARIO
        self._neutral_since: float | None = None

    def report(self, source: str, sticks: Sticks, now: float) -> None:
        """Take a live source's sticks."""
        with self._lock:
            self._reports[source] = (sticks, now)

    def release(self, source: str) -> None:
        """Forget a live source: it is disconnected, or what it says is of no use."""
        with self._lock:
            self._reports.pop(source, None)

    def decide(self, now: float, scenario: Sticks) -> Command:
        """Return who is in command at `now`, given the scenario's sticks."""
        with self._lock:
            wanted = next((s for s in LIVE_SOURCES if self._sticks(s, now) != NEUTRAL), SCENARIO)
            if _RANK[wanted] > _RANK[self._in_command]:
                if self._neutral_since is None:
                    self._neutral_since = now
                if now - self._neutral_since < PAUSE_S:
                    return Command(self._in_command, NEUTRAL)
            self._in_command, self._neutral_since = wanted, None
            return Command(wanted, scenario if wanted == SCENARIO else self._sticks(wanted, now))

    def _sticks(self, source: str, now: float) -> Sticks:
        sticks, at = self._reports.get(source, (NEUTRAL, now))
        return NEUTRAL if now - at > SILENCE_S else sticks
