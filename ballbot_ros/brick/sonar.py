"""The ultrasonic sensor on port S3."""

from __future__ import annotations

from ballbot_ros.brick.units import NO_ECHO_CM, quantise

NEAR_DROPOUT = 0.5
"""Minimum share of missed echoes from an obstacle closer than the minimum range."""


def sonar_reading(
    distance_m: float,
    chance: float,
    error: float,
    noise_cm: float,
    dropout: float,
    min_range_cm: float,
    max_range_cm: float,
) -> int:
    """Return the reading [cm]; 255 for no echo.

    Parameters
    ----------
    distance_m : float
        Distance to an obstacle [m], +inf if there is none.
    chance, error : float
        Uniform numbers, 0 ... 1, for the dropout and for the noise.
    noise_cm : float
        Bound of the noise [cm].
    dropout : float
        Share of missed echoes.
    min_range_cm, max_range_cm : float
        Minimum and maximum range [cm].
    """
    distance = distance_m * 100.0
    if distance >= max_range_cm:
        return NO_ECHO_CM
    if chance < (max(dropout, NEAR_DROPOUT) if distance < min_range_cm else dropout):
        return NO_ECHO_CM
    return max(0, min(NO_ECHO_CM, quantise(distance + noise_cm * (2.0 * error - 1.0))))
