"""The arbiter, which selects the input that drives the robot."""

from __future__ import annotations

from collections.abc import Callable
from threading import Lock
from typing import NamedTuple

from ballbot_ros.parameters.timing import MAX_LEAD_TICKS, SLOW_PERIOD_NS, TICK_NS
from ballbot_ros.recording.messages.topics import SCENARIO
from ballbot_ros.robot.brick.bluetooth import NEUTRAL, Sticks

LIVE_SOURCES = DEVICE, JOY, VIEWER, KEYBOARD, CMD_VEL = (
    'device',
    'joy',
    'viewer',
    'keyboard',
    'cmd_vel',
)
"""The live inputs in order of priority."""

NO_SOURCE = 'nobody'
"""Name displayed while no live input is in command and there is no scenario."""

SILENCE_S = 0.5
"""Silence after which a source counts as neutral."""

TAKEOVER_DELAY_S = 0.5
"""Time for which the sticks are neutral before a source of lower priority takes over."""

MAX_KEPT_ANSWERS = MAX_LEAD_TICKS * TICK_NS // SLOW_PERIOD_NS + 1
"""Number of answers kept: the plant may ask again for any tick that the recorder lacks."""

_RANK = {source: rank for rank, source in enumerate((*LIVE_SOURCES, SCENARIO))}


class Command(NamedTuple):
    """The source in command, and the sticks that go to the robot."""

    source: str
    sticks: Sticks

    def source_name(self, scenario: str) -> str:
        """Return the displayed name of the source in command; `scenario` is '' if there is none."""
        return self.source if self.source != SCENARIO or scenario else NO_SOURCE


class Arbiter:
    """Stores the newest sticks of each source and selects one of them.

    The live source of the highest priority whose sticks are not neutral is in command. When it
    becomes neutral, is released or falls silent, the sticks are neutral at once. The same source,
    or one of higher priority, can take command at any time; one of lower priority only after
    :data:`TAKEOVER_DELAY_S`. Sources may report from any thread. All times are from one monotonic
    clock [s].
    """

    def __init__(self) -> None:
        self._lock = Lock()
        self._reports: dict[str, tuple[Sticks, float]] = {}
        self._in_command = SCENARIO
        self._neutral_since: float | None = None

    def report(self, source: str, sticks: Sticks, now_s: float) -> None:
        """Store the sticks of a live source."""
        with self._lock:
            self._reports[source] = (sticks, now_s)

    def release(self, source: str) -> None:
        """Remove a live source that is disconnected or unusable."""
        with self._lock:
            self._reports.pop(source, None)

    def select(self, now_s: float, scenario: Sticks) -> Command:
        """Return the command at `now_s`, given the scenario's sticks."""
        with self._lock:
            wanted = next((s for s in LIVE_SOURCES if self._sticks(s, now_s) != NEUTRAL), SCENARIO)
            if _RANK[wanted] > _RANK[self._in_command]:
                if self._neutral_since is None:
                    self._neutral_since = now_s
                if now_s - self._neutral_since < TAKEOVER_DELAY_S:
                    return Command(self._in_command, NEUTRAL)
            self._in_command, self._neutral_since = wanted, None
            return Command(wanted, scenario if wanted == SCENARIO else self._sticks(wanted, now_s))

    def _sticks(self, source: str, now_s: float) -> Sticks:
        sticks, at = self._reports.get(source, (NEUTRAL, now_s))
        return NEUTRAL if now_s - at > SILENCE_S else sticks


class GivenAnswers:
    """Repeats the answer of a tick that the plant asks for again, whatever the live inputs are."""

    def __init__(self) -> None:
        self._answers: dict[int, Command] = {}

    def at(self, stamp_ns: int, select: Callable[[], Command]) -> Command:
        """Return the answer given at a stamp [ns]; select it if there is none."""
        answer = self._answers.get(stamp_ns)
        if answer is None:
            answer = self._answers[stamp_ns] = select()
            if len(self._answers) > MAX_KEPT_ANSWERS:
                del self._answers[next(iter(self._answers))]
        return answer
