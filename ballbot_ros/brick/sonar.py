"""The ultrasonic sensor on port S3."""

from __future__ import annotations

from ballbot_ros.brick.noise import DeviceNoise
from ballbot_ros.brick.units import NO_ECHO_CM, quantise
from ballbot_ros.numerics.random_numbers import uniform
from ballbot_ros.parameters import SonarParameters
from ballbot_ros.timing import SLOW_PERIOD_NS

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


class Sonar:
    """Distance in whole centimetres; 255 means no echo."""

    def __init__(self, parameters: SonarParameters) -> None:
        self._error: float = parameters.noise_cm
        self._dropout: float = parameters.dropout_probability
        self._max_range: float = parameters.max_range_cm
        self._min_range: float = parameters.min_range_cm
        self._noise = DeviceNoise(parameters.seed, 'sonar', uniform)

    def read(self, distance_m: float, stamp_ns: int) -> int:
        """Return the reading [cm] for the distance [m] to an obstacle, +inf if there is none."""
        chance, error = self._noise.pair(stamp_ns // SLOW_PERIOD_NS)
        return sonar_reading(
            distance_m, chance, error,
            self._error, self._dropout, self._min_range, self._max_range,
        )  # fmt: skip
