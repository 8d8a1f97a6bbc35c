"""The brick's sensors: their units, quantisation, errors and dead times.

An integer sent as rad or m comes back as the same integer.

The reading of a gyro is the angular rate in deg/s plus the zero-rate offset, as a 10-bit number.
The rate saturates at the gyro's range; offset, drift and noise add to it; the sum is rounded and
bounded by the converter. The drift is a sine whose phase is drawn from the seed.

Dead time is how old samples are, and how late a duty takes effect. It is in whole physics steps,
and depends on parameters, the seed and the time alone, like the noise of a device: a driver that
restarts in mid-run continues with the same ages.
"""

from __future__ import annotations

import math

from ballbot_ros.robot.arithmetic import TWO_PI, sine_cosine

RADIANS_PER_DEGREE = math.pi / 180.0
_DEGREES_PER_RADIAN = 180.0 / math.pi

NO_ECHO_CM = 255
NO_DATA_CM = -1
"""Reading of a sonar that does not answer."""


def quantise(value: float) -> int:
    """Round to the nearest integer, halves up: floor(x + 0.5)."""
    return math.floor(value + 0.5)


def _degrees_of(radians: float) -> float:
    """Return rad (or rad/s) in degrees (or deg/s)."""
    return radians * _DEGREES_PER_RADIAN


def radians_to_degrees(radians: float) -> int:
    """Return the whole degrees (or deg/s) nearest to rad (or rad/s)."""
    return quantise(_degrees_of(radians))


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


ADC_BITS = 10
FULL_SCALE_MV = 14180
"""Voltage of count 1024, one above the largest."""


COUNT_V = FULL_SCALE_MV / (1 << ADC_BITS) / 1000.0
"""Voltage of one count [V]."""


def count_of(reading_mv: int) -> int:
    """Return the count that a reading of :func:`battery_mv` stands for."""
    return -(-(reading_mv << ADC_BITS) // FULL_SCALE_MV)


def battery_mv(voltage: float) -> int:
    """Return what ``ecrobot_get_battery_voltage`` reads [mV] at a voltage [V].

    The converter has 10 bits and rounds to the nearest count; nxtOSEK scales the count in
    integers and truncates.
    """
    counts = quantise(voltage * 1000.0 * (1 << ADC_BITS) / FULL_SCALE_MV)
    counts = max(0, min((1 << ADC_BITS) - 1, counts))
    return (counts * FULL_SCALE_MV) >> ADC_BITS


INT32_MIN, INT32_MAX = -(2**31), 2**31 - 1


def encoder_reading(angle: float) -> int:
    """Return the whole degrees of a shaft angle [rad]; a counter has 32 bits, and stops there."""
    return quantise(max(float(INT32_MIN), min(float(INT32_MAX), _degrees_of(angle))))


ADC_MAX = 1023


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
    value = max(-limit, min(limit, _degrees_of(rate))) + offset
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


def drawn_delay(delay: int, jitter: int, chance: float) -> int:
    """Return a dead time of `delay` to `delay + jitter` steps, all equally likely.

    `chance` is a uniform number within [0, 1).
    """
    return delay + int(chance * (jitter + 1))


def mean_delay(delay: int, jitter: int, period: int) -> float:
    """Return the mean dead time [steps] of samples or duties of a `period` [steps].

    With jitter it is less than the mean of the drawn ones: it is more than `a` only if that also
    holds for each sample or duty before, plus the time since then.
    """
    mean, highest = 0.0, delay + jitter
    for age in range(highest):
        chance = 1.0
        for excess in range(age % period, age + 1, period):
            if excess >= delay:
                chance *= (highest - excess) / (jitter + 1)
        mean += chance
    return mean
