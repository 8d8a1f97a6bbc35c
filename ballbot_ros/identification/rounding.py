"""What the rounding of a device adds to its readings on average."""

from __future__ import annotations

import math

import numpy as np

from ballbot_ros.identification.arrays import Floats

ROUNDING_DEVIATION = math.sqrt(1.0 / 12.0)
"""Standard deviation of the rounding to whole numbers, of a signal that moves."""

_LEAST_NOISE = 0.1
_LEAST_COMMON = 0.02
_TERMS = 8


def expected_rounding(values: Floats, noise: float) -> Floats:
    """Return the mean of ``floor(x + e + 0.5) - x`` for each value x, with a normal error e.

    It is the Fourier series of the sawtooth, whose harmonics the noise damps. With a noise of half
    a count or more it is close to zero. Less noise than a tenth counts as a tenth, so that values
    that are known to a tenth only have no sharp edges.
    """
    total = np.zeros_like(values)
    for harmonic in range(1, _TERMS + 1):
        damping = math.exp(-2.0 * (math.pi * harmonic * max(noise, _LEAST_NOISE)) ** 2)
        size = (-1) ** harmonic / (math.pi * harmonic) * damping
        total += size * np.sin(2.0 * math.pi * harmonic * values)
    return total


def common_rounding(spread: float) -> float:
    """Return the standard deviation of the mean rounding of values that are spread normally.

    Values that all round alike have all of it in common; with a spread of half a count, hardly
    anything is left.
    """
    if spread == 0.0:
        return ROUNDING_DEVIATION
    variance = sum(
        math.exp(-4.0 * (math.pi * harmonic * spread) ** 2) / (2.0 * (math.pi * harmonic) ** 2)
        for harmonic in range(1, _TERMS + 1)
    )
    return max(_LEAST_COMMON, math.sqrt(variance))
