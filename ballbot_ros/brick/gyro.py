"""The two HiTechnic gyros on ports S1 (plane x) and S2 (plane y)."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from ballbot_ros.brick.noise import DeviceNoise
from ballbot_ros.brick.units import quantise
from ballbot_ros.numerics.elementary import TWO_PI, sine_cosine
from ballbot_ros.numerics.random_numbers import normal, uniform

ADC_MAX = 1023
_SAMPLE_NS = 4_000_000
_DEGREES = 180.0 / math.pi


class Gyro:
    """Angular rate in deg/s plus the zero-rate offset, as a 10-bit reading.

    The rate saturates at the gyro's range; offset, drift and noise add to it; the sum is rounded
    and bounded by the converter. The drift is a sine whose phase is drawn from the seed.

    Parameters
    ----------
    values : mapping
        The parameters of ``gyro_driver``.
    """

    def __init__(self, values: Mapping[str, Any]) -> None:
        self._offsets = (values['zero_rate_offset_x'], values['zero_rate_offset_y'])
        self._limit: float = values['rate_limit']
        self._sigma: float = values['noise']
        self._drift: float = values['drift']
        self._drift_period_ns = round(values['drift_period'] * 1e9)
        seed: int = values['seed']
        self._noise = DeviceNoise(seed, 'gyro', normal)
        self._drift_phases = DeviceNoise(seed, 'gyro drift', uniform).pair(0)

    def read(self, rates: tuple[float, float], stamp_ns: int) -> tuple[int, int]:
        """Return the readings of both gyros [deg/s + offset], 0 ... 1023.

        Parameters
        ----------
        rates : tuple of float
            Body pitch rates [rad/s] of planes x and y.
        stamp_ns : int
            Sim time [ns] of the sample.
        """
        errors = self._noise.pair(stamp_ns // _SAMPLE_NS) if self._sigma else (0.0, 0.0)
        return (
            self._reading(0, rates[0], errors[0], stamp_ns),
            self._reading(1, rates[1], errors[1], stamp_ns),
        )

    def _reading(self, axis: int, rate: float, error: float, stamp_ns: int) -> int:
        limit = self._limit
        value = max(-limit, min(limit, rate * _DEGREES)) + self._offsets[axis]
        if self._drift:
            # In periods, of which the whole ones are left out exactly.
            phase = stamp_ns % self._drift_period_ns / self._drift_period_ns
            value += self._drift * sine_cosine(TWO_PI * (phase + self._drift_phases[axis]))[0]
        if self._sigma:
            value += self._sigma * error
        return max(0, min(ADC_MAX, quantise(value)))
