"""The tasks: balancing on the spot, and driving at a commanded speed.

What they compute is that of one robot, or in columns that of many.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

TOLERATED_PITCH_RAD = 0.035
TOLERATED_DISTANCE_M = 0.05
TOLERATED_SPEED_M_PER_S = 0.05
TOLERATED_DUTY_PERCENT = 42.4
"""Length of the vector of both duties."""

Numbers = Any
"""A number, or a column of them."""

Vector = tuple[Numbers, ...]

Parts = dict[str, Numbers]
"""The parts of a reward, by the names that they have in the info."""


@dataclass(frozen=True)
class Task:
    """A task.

    Attributes
    ----------
    duration : float
        Time after which an episode is truncated, unless another one is given [s].
    largest_pitch : float
        Largest random pitch at the start, in each plane [rad].
    drives : bool
        Whether speeds are commanded.
    reward : callable
        Returns the reward of a step, and its parts, for the true state that it ends in, the
        velocity that was commanded [m/s] and the duty [%].
    """

    name: str
    duration: float
    largest_pitch: float
    drives: bool
    reward: Callable[[Vector, Vector, Vector], tuple[Numbers, Parts]]


def closeness(x: Numbers, y: Numbers, tolerated: float) -> Numbers:
    """Return how small a vector is: 1 for zero, 0.5 for one of `tolerated` length."""
    scale = tolerated * tolerated
    return scale / (scale + x * x + y * y)


def _balance_reward(state: Vector, commanded: Vector, duty: Vector) -> tuple[Numbers, Parts]:
    x, y, _, _, pitch_x, pitch_y, *_ = state
    upright = closeness(pitch_x, pitch_y, TOLERATED_PITCH_RAD)
    near = closeness(x, y, TOLERATED_DISTANCE_M)
    calm = closeness(duty[0], duty[1], TOLERATED_DUTY_PERCENT)
    return 0.4 * upright + 0.4 * near + 0.2 * calm, {
        'reward_upright': upright,
        'reward_near': near,
        'reward_calm': calm,
    }


def _drive_reward(state: Vector, commanded: Vector, duty: Vector) -> tuple[Numbers, Parts]:
    _, _, velocity_x, velocity_y, pitch_x, pitch_y, *_ = state
    upright = closeness(pitch_x, pitch_y, TOLERATED_PITCH_RAD)
    follow = closeness(
        velocity_x - commanded[0], velocity_y - commanded[1], TOLERATED_SPEED_M_PER_S
    )
    calm = closeness(duty[0], duty[1], TOLERATED_DUTY_PERCENT)
    return 0.3 * upright + 0.5 * follow + 0.2 * calm, {
        'reward_upright': upright,
        'reward_follow': follow,
        'reward_calm': calm,
    }


BALANCE = Task('Balance', 10.0, math.radians(4.0), False, _balance_reward)
DRIVE = Task('Drive', 20.0, math.radians(1.0), True, _drive_reward)
