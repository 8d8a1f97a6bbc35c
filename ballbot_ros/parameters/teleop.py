"""Parameters of the gamepad node."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from ballbot_ros.parameters.parameter import DriverParameters, path, quantity, setting
from ballbot_ros.parameters.shared import BallRadius, LockstepChoice, ScenarioChoice, StickScale
from ballbot_ros.timing import SLOW_PERIOD_NS

SHARE = (0.0, 1.0)


@dataclass(frozen=True, kw_only=True)
class GamepadParameters(BallRadius, StickScale, ScenarioChoice, LockstepChoice, DriverParameters):
    """The parameters of ``gamepad_teleop``."""

    node: ClassVar[str] = 'gamepad_teleop'
    period_ns: ClassVar[int] = SLOW_PERIOD_NS

    device: str = setting(
        'any',
        'gamepad to read directly: any, its number, or part of its name; empty: none',
        'project',
    )
    keyboard: bool = setting(False, 'true: the arrow keys of the terminal drive', 'project')
    log_csv: str = path(
        'CSV file for the data log, a new one after each reset; empty: none', 'facts'
    )
    require_enable_button: bool = setting(
        False,
        'true: the sticks of joy and gamepad only work while the enable button is pressed',
        'project',
    )
    enable_button: int = quantity(
        9, '1', (0, 63), 'enable button; 9 is the left shoulder', 'project'
    )
    enable_turbo_button: int = quantity(
        -1, '1', (-1, 63), 'button for the turbo scales, which also enables; -1: none', 'project'
    )
    deadzone: float = quantity(
        0.05, '1', (0.0, 0.95), 'neutral share of an axis around its centre', 'project'
    )
    axis_forward: int = quantity(1, '1', (-1, 63), 'axis that drives forward; -1: none', 'project')
    axis_rightward: int = quantity(
        2, '1', (-1, 63), 'axis that drives rightward; -1: none', 'project'
    )
    scale_forward: float = quantity(
        1.0, '1', SHARE, 'share of the full stick at a full axis', 'project'
    )
    scale_rightward: float = quantity(
        1.0, '1', SHARE, 'share of the full stick at a full axis', 'project'
    )
    scale_forward_turbo: float = quantity(
        1.0, '1', SHARE, 'share of the full stick at a full axis, turbo button', 'project'
    )
    scale_rightward_turbo: float = quantity(
        1.0, '1', SHARE, 'share of the full stick at a full axis, turbo button', 'project'
    )
    invert_forward: bool = setting(False, 'true: the forward axis is reversed', 'project')
    invert_rightward: bool = setting(False, 'true: the rightward axis is reversed', 'project')
