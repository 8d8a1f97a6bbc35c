"""The two HiTechnic gyros on ports S1 (plane x) and S2 (plane y).

A reading is the angular rate in deg/s plus the zero-rate offset, as a 10-bit number. The rate
saturates at the gyro's range; offset, drift and noise add to it; the sum is rounded and bounded by
the converter. The drift is a sine whose phase is drawn from the seed.
"""

from __future__ import annotations

import math

from ballbot_ros.brick.units import quantise
from ballbot_ros.numerics.elementary import TWO_PI, sine_cosine

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


def gyro_offset(constants: GyroConstants, stamp_ns: int) -> float:
    """Return the true offset [deg/s] at a sim time [ns]: the reading at rest, without noise."""
    offset, _, _, drift, period_ns, phase = constants
    return offset + drift * sine_cosine(TWO_PI * (stamp_ns % period_ns / period_ns + phase))[0]
