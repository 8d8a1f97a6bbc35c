"""The two sticks: the input in command, and how inputs map to them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from threading import Lock
from typing import NamedTuple

from ballbot_ros.errors import TeleopError
from ballbot_ros.parameters import Subset
from ballbot_ros.recording.messages.topics import SCENARIO
from ballbot_ros.robot.brick.bluetooth import NEUTRAL, Sticks, sticks_of

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


@dataclass(frozen=True)
class VelocityMapping(Subset):
    """The inverse of the controller's mapping from sticks to speed.

    The ball's rate at a full stick (`gp_max`) is `k_thetadot` [deg/s]; its radius is Rs [m].
    """

    k_thetadot: float
    ball_radius: float
    gp_max: int

    @property
    def full_speed(self) -> float:
        """Speed at a full stick [m/s]."""
        return math.radians(self.k_thetadot) * self.ball_radius

    def sticks(self, forward: float, left: float) -> Sticks:
        """Return the sticks for a velocity [m/s] in the axes of REP 103.

        A velocity beyond the full stick is scaled down in both planes, which keeps its direction.
        It raises TeleopError if a component is not finite.
        """
        for name, value in (('linear.x', forward), ('linear.y', left)):
            if not math.isfinite(value):
                raise TeleopError(f'{name} is {value:g}, not a finite number')
        full = max(self.full_speed, abs(forward), abs(left))
        if not full or not self.full_speed:
            return NEUTRAL
        return sticks_of(forward / full, -left / full, self.gp_max)


NOT_USED = -1
"""Number that leaves out an axis or button."""

_ROUNDING = 1e-6
"""Tolerance beyond ±1 for a full stick, since drivers compute in single precision."""


@dataclass(frozen=True)
class JoyMapping(Subset):
    """The axes and buttons that drive, and their scales.

    Axes and buttons are numbered as in ``game_controller_node`` of the package joy: axes 0 and 1
    are the left stick, axes 2 and 3 the right stick, each with left and up positive; buttons 9 and
    10 are the shoulder buttons. The other fields have the names and meanings of
    ``teleop_twist_joy``. The turbo button also enables the sticks.

    Attributes
    ----------
    gp_max : int
        Value of a fully deflected stick.
    require_enable_button : bool
        Whether the sticks only work while a button is pressed.
    enable_button, enable_turbo_button : int
        Buttons that enable the sticks, with normal and with turbo scales.
    deadzone : float
        Neutral share of an axis around its centre; the rest is scaled to the full range.
    scale_forward, scale_rightward, scale_forward_turbo, scale_rightward_turbo : float
        Share of the full stick at a full axis, 0 ... 1.
    """

    gp_max: int
    require_enable_button: bool = False
    enable_button: int = 9
    enable_turbo_button: int = NOT_USED
    deadzone: float = 0.0
    axis_forward: int = 1
    axis_rightward: int = 2
    scale_forward: float = 1.0
    scale_rightward: float = 1.0
    scale_forward_turbo: float = 1.0
    scale_rightward_turbo: float = 1.0
    invert_forward: bool = False
    invert_rightward: bool = False

    def sticks(self, axes: Sequence[float], buttons: Sequence[int]) -> Sticks | None:
        """Return the sticks, or None while a required enable button is not pressed.

        Axes are -1 ... 1, left and up positive; a pressed button is 1. It raises TeleopError if an
        axis or button in use does not exist, or an axis is not within ±1.
        """
        forward = self._axis(axes, self.axis_forward)
        rightward = -self._axis(axes, self.axis_rightward)
        turbo = self._pressed(buttons, self.enable_turbo_button)
        if self.require_enable_button and not (self._pressed(buttons, self.enable_button) or turbo):
            return None
        scale_forward = self.scale_forward_turbo if turbo else self.scale_forward
        scale_rightward = self.scale_rightward_turbo if turbo else self.scale_rightward
        return sticks_of(
            forward * scale_forward * (-1.0 if self.invert_forward else 1.0),
            rightward * scale_rightward * (-1.0 if self.invert_rightward else 1.0),
            self.gp_max,
        )

    def _axis(self, axes: Sequence[float], number: int) -> float:
        if number == NOT_USED:
            return 0.0
        if number >= len(axes):
            raise TeleopError(f'axis {number} not found: the input has only {len(axes)} axes')
        value = float(axes[number])
        if not abs(value) <= 1.0 + _ROUNDING:
            raise TeleopError(f'axis {number} is {value:g}, not within -1 … 1')
        beyond = max(0.0, min(abs(value), 1.0) - self.deadzone) / (1.0 - self.deadzone)
        return beyond if value > 0.0 else -beyond

    def _pressed(self, buttons: Sequence[int], number: int) -> bool:
        if number == NOT_USED:
            return False
        if number >= len(buttons):
            raise TeleopError(
                f'button {number} not found: the input has only {len(buttons)} buttons'
            )
        return bool(buttons[number])
