"""Parts of the rewards: each is 1 at best, and above 0."""

from __future__ import annotations

from ballbot_ros.robot.plant.ground_truth import Pair

TOLERATED_PITCH_RAD = 0.035
TOLERATED_DISTANCE_M = 0.05
TOLERATED_SPEED_M_PER_S = 0.05
TOLERATED_DUTY_PERCENT = 42.4
"""Length of the vector of both duties."""


def closeness(x: float, y: float, tolerated: float) -> float:
    """Return how small a vector is: 1 for zero, 0.5 for one of `tolerated` length."""
    scale = tolerated * tolerated
    return scale / (scale + x * x + y * y)


def upright(pitch: Pair) -> float:
    """Return how upright the body is; 0.5 at 2 degrees [rad]."""
    return closeness(*pitch, TOLERATED_PITCH_RAD)


def near(position: Pair) -> float:
    """Return how near the ball is to its start; 0.5 at 5 cm [m]."""
    return closeness(*position, TOLERATED_DISTANCE_M)


def follow(error: Pair) -> float:
    """Return how well the ball follows the commanded speed; 0.5 for an error of 5 cm/s [m/s]."""
    return closeness(*error, TOLERATED_SPEED_M_PER_S)


def calm(duty: tuple[int, int]) -> float:
    """Return how small the duty is; 0.5 for about 30 % in both planes [%]."""
    return closeness(*duty, TOLERATED_DUTY_PERCENT)
