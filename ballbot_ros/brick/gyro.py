"""The two HiTechnic gyros on ports S1 (plane x) and S2 (plane y)."""

from __future__ import annotations

import math

from ballbot_ros.brick.noise import DeviceNoise
from ballbot_ros.brick.units import quantise
from ballbot_ros.numerics.elementary import TWO_PI, sine_cosine
from ballbot_ros.numerics.random_numbers import normal, uniform
from ballbot_ros.parameters import GyroParameters
from ballbot_ros.timing import TICK_NS

ADC_MAX = 1023
_DEGREES = 180.0 / math.pi


GyroConstants = tuple[float, float, float, float, int, float]
"""Constants of :func:`gyro_reading`.

Reading at rest, range of the rate, standard deviation of the noise and amplitude of the drift
[deg/s]; period of the drift [ns] and its phase at time 0, in periods.
"""


def gyro_reading(constants: GyroConstants, rate: float, error: float, stamp_ns: int) -> int:
    """Return the reading [deg/s + offset], 0 ... 1023, at a sim time [ns].

    `rate` is the body's pitch rate [rad/s], `error` a normal number.
    """
    offset, limit, sigma, drift, drift_period_ns, drift_phase = constants
    value = max(-limit, min(limit, rate * _DEGREES)) + offset
    if drift:
        # Reduce the time to the fraction of a period, by the exact remainder of integers.
        phase = stamp_ns % drift_period_ns / drift_period_ns
        value += drift * sine_cosine(TWO_PI * (phase + drift_phase))[0]
    if sigma:
        value += sigma * error
    return max(0, min(ADC_MAX, quantise(value)))


class Gyro:
    """Angular rate in deg/s plus the zero-rate offset, as a 10-bit reading.

    The rate saturates at the gyro's range; offset, drift and noise add to it; the sum is rounded
    and bounded by the converter. The drift is a sine whose phase is drawn from the seed.
    """

    def __init__(self, parameters: GyroParameters) -> None:
        offsets = (parameters.zero_rate_offset_x, parameters.zero_rate_offset_y)
        self._sigma = parameters.noise
        drift_period_ns = round(parameters.drift_period * 1e9)
        seed = parameters.seed
        self._noise = DeviceNoise(seed, 'gyro', normal)
        self._x, self._y = (
            (offset, parameters.rate_limit, self._sigma, parameters.drift, drift_period_ns, phase)
            for offset, phase in zip(
                offsets, DeviceNoise(seed, 'gyro drift', uniform).pair(0), strict=True
            )
        )

    def read(self, rates: tuple[float, float], stamp_ns: int) -> tuple[int, int]:
        """Return the readings of both gyros [deg/s + offset], 0 ... 1023, at a sim time [ns].

        The rates are the body's pitch rates [rad/s] of planes x and y.
        """
        errors = self._noise.pair(stamp_ns // TICK_NS) if self._sigma else (0.0, 0.0)
        return (
            gyro_reading(self._x, rates[0], errors[0], stamp_ns),
            gyro_reading(self._y, rates[1], errors[1], stamp_ns),
        )

    def offsets(self, stamp_ns: int) -> tuple[float, float]:
        """Return the true offsets [deg/s] at a sim time [ns]: what drifts, without noise."""
        x, y = (_offset(constants, stamp_ns) for constants in (self._x, self._y))
        return x, y


def _offset(constants: GyroConstants, stamp_ns: int) -> float:
    offset, _, _, drift, period_ns, phase = constants
    return offset + drift * sine_cosine(TWO_PI * (stamp_ns % period_ns / period_ns + phase))[0]
