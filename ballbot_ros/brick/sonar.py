"""The ultrasonic sensor on port S3."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ballbot_ros.brick.noise import DeviceNoise
from ballbot_ros.brick.units import NO_ECHO_CM, quantise
from ballbot_ros.numerics.random_numbers import uniform

SAMPLE_NS = 20_000_000
NEAR_DROPOUT = 0.5
"""Share of the echoes of an obstacle nearer than the least range that are missed."""


class Sonar:
    """Distance in whole centimetres; 255 means no echo.

    Parameters
    ----------
    values : mapping
        The parameters of ``sonar_driver``.
    """

    def __init__(self, values: Mapping[str, Any]) -> None:
        self._error: float = values['noise_cm']
        self._dropout: float = values['dropout_probability']
        self._max_range: float = values['max_range_cm']
        self._min_range: float = values['min_range_cm']
        self._noise = DeviceNoise(values['seed'], 'sonar', uniform)

    def read(self, distance_m: float, stamp_ns: int) -> int:
        """Return the reading [cm] for the distance [m] to an obstacle, +inf if there is none."""
        distance = distance_m * 100.0
        if distance >= self._max_range:
            return NO_ECHO_CM
        chance, error = self._noise.pair(stamp_ns // SAMPLE_NS)
        near = distance < self._min_range
        if chance < (max(self._dropout, NEAR_DROPOUT) if near else self._dropout):
            return NO_ECHO_CM
        return max(0, min(NO_ECHO_CM, quantise(distance + self._error * (2.0 * error - 1.0))))
