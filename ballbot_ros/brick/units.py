"""Conversions between SI and the brick's integers, exact in both directions.

An integer sent as rad or m comes back as the same integer.
"""

from __future__ import annotations

import math

RADIANS_PER_DEGREE = math.pi / 180.0
_DEGREES_PER_RADIAN = 180.0 / math.pi

NO_ECHO_CM = 255
NO_DATA_CM = -1
"""Reading of a sonar that does not answer."""


def quantise(value: float) -> int:
    """Round to the nearest integer, halves up: floor(x + 0.5)."""
    return math.floor(value + 0.5)


def degrees_of(radians: float) -> float:
    """Return rad (or rad/s) in degrees (or deg/s)."""
    return radians * _DEGREES_PER_RADIAN


def radians_to_degrees(radians: float) -> int:
    """Return the whole degrees (or deg/s) nearest to rad (or rad/s)."""
    return quantise(degrees_of(radians))


def degrees_to_radians(degrees: float) -> float:
    """Return degrees (or deg/s) in rad (or rad/s)."""
    return degrees * RADIANS_PER_DEGREE


def sonar_cm_to_metres(sonar_cm: int) -> float:
    """Return a sonar reading in m: +inf for no echo, NaN for no data yet (REP 117)."""
    if sonar_cm == NO_ECHO_CM:
        return math.inf
    if sonar_cm == NO_DATA_CM:
        return math.nan
    return sonar_cm / 100.0


def metres_to_sonar_cm(range_m: float) -> int:
    """Return the sonar reading that :func:`sonar_cm_to_metres` converted to `range_m`."""
    if math.isnan(range_m):
        return NO_DATA_CM
    if math.isinf(range_m):
        return NO_ECHO_CM
    return quantise(range_m * 100.0)
