"""Dead reckoning with the brick's own sensors: where the robot is, how fast, and how certainly.

The ball rolls without slip, so its angle is theta = theta_m / k + psi. The encoders count theta_m.
The gyros measure the rate of the body's pitch psi, with an offset: the mean of their readings
while the robot is held still. What is left of the offset makes the integral of the rate drift. The
drift is bounded by what is known of a robot that balances: on average, its pitch is zero. A Kalman
filter of each plane, with the states pitch and remaining offset, weighs both once a second.

Angles are in degrees here, as the brick counts them, and results are in SI.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ballbot_ros.parameters.timing import SECOND_NS, TICK_NS
from ballbot_ros.robot.arithmetic import Floats

CALIBRATION_NS = SECOND_NS
"""Time from the start of a run in which the offsets of the gyros are measured [ns]."""

WINDOW_NS = 10 * TICK_NS
"""Time over which a velocity is measured [ns]."""

_TILT_PERIOD_NS = SECOND_NS
_TILT_VARIANCE = 4.0 * 4.0
"""Variance of the pitch of a robot that balances or drives [deg²]."""

_FALLING = 15.0
"""Pitch from which on the robot does not balance [deg], as for the controller (psi_diff_thr)."""

_ROUNDING = 1.0 / 12.0
"""Variance of the rounding to whole numbers, as of a uniform error."""

_GEAR_PLAY = 2.0 * 2.0 / 3.0
"""Variance of the wheel's angle in the gear play of ±2 deg, which no encoder sees [deg²]."""

_DRIFT = 0.02 * 0.02
"""Growth of the variance of the offset in a second [(deg/s)²/s]."""

_CORRELATION = 10.0
"""Number of independent readings assumed in the calibration: the robot may not be quite still."""

_ACCELERATION = 0.5
"""Standard deviation of the ball's acceleration [m/s²]."""

_AGE = 0.8 * 0.8
"""Variance of the change of the body's rate within the age of a reading that passes the link: some
200 deg/s² for 4 ms [(deg/s)²]."""

_RADIANS = math.pi / 180.0

Rows = NDArray[np.intp]

_KEPT = WINDOW_NS // TICK_NS


class Estimate(NamedTuple):
    """A quantity of planes x and y, in plane signs, with its variances; shapes (2, n)."""

    value: Floats
    variance: Floats


class OdometryState(NamedTuple):
    """The robot's motion as it measures it, at n ticks.

    Attributes
    ----------
    position, velocity : Estimate
        How far the ball has rolled from the start [m], and its rate [m/s].
    pitch, pitch_rate : Estimate
        The body's pitch [rad], and its rate without the gyros' offset [rad/s].
    """

    position: Estimate
    velocity: Estimate
    pitch: Estimate
    pitch_rate: Estimate


class _Pitch:
    """Pitch of a plane, from its gyro: a Kalman filter whose states are pitch and offset error."""

    def __init__(self) -> None:
        self.pitch = self.rate = 0.0
        self.variance = _TILT_VARIANCE
        self.rate_variance = _ROUNDING
        self._offset = 0.0
        self._covariance, self._offset_variance = 0.0, _ROUNDING
        self._count = self._mean = self._squares = 0.0

    def calibrate(self, reading: int) -> None:
        """Take a reading [deg/s] of a robot at rest into the offset (Welford's algorithm)."""
        self._count += 1.0
        deviation = reading - self._mean
        self._mean += deviation / self._count
        self._squares += deviation * (reading - self._mean)
        noise = self._squares / self._count
        self._offset = self._mean
        self._offset_variance = _ROUNDING + noise / _CORRELATION
        self.rate_variance = max(noise, _ROUNDING) + self._offset_variance

    def integrate(self, readings: Floats, seconds: Floats) -> Floats:
        """Turn on by readings [deg/s], each for some time; return pitch and rate after each."""
        rates = readings - self._offset
        pitches = np.cumsum(np.append(self.pitch, rates * seconds))[1:]
        self.pitch, self.rate = float(pitches[-1]), float(rates[-1])
        return np.array([pitches, rates])

    @property
    def values(self) -> tuple[float, float, float, float]:
        """Pitch and rate, and their variances."""
        return self.pitch, self.rate, self.variance, self.rate_variance

    def settle(self, seconds: float) -> None:
        """Let the uncertainty grow for some time, and weigh the pitch with its mean of zero."""
        noise = (self.rate_variance - self._offset_variance) * seconds * TICK_NS / SECOND_NS
        self.variance += (
            -2.0 * self._covariance * seconds + self._offset_variance * seconds * seconds + noise
        )
        self._covariance -= self._offset_variance * seconds
        self._offset_variance += _DRIFT * seconds
        if abs(self.pitch) >= _FALLING:
            return
        innovation = self.variance + _TILT_VARIANCE
        gain, offset_gain = self.variance / innovation, self._covariance / innovation
        self._offset -= offset_gain * self.pitch
        self.pitch -= gain * self.pitch
        self._offset_variance -= offset_gain * self._covariance
        self._covariance *= 1.0 - gain
        self.variance *= 1.0 - gain


class DeadReckoning:
    """Estimates the robot's motion from the readings of gyros and encoders.

    The radii are Rs and Rw [m]; `now_ns` is the stamp of the newest reading [ns], 0 before the
    first.
    """

    def __init__(self, ball_radius: float, wheel_radius: float) -> None:
        self._ball_radius, self._wheel_radius = ball_radius, wheel_radius
        self._planes = (_Pitch(), _Pitch())
        self._start_ns = self._settled_ns = self.now_ns = 0
        self._newest = 0
        self._stamps = np.zeros(0, np.int64)
        self._track = np.zeros((0, 2, 5))  # of both planes: values of the pitch, count

    def add(self, stamps_ns: NDArray[np.int64], gyro: Floats, encoders: Floats) -> None:
        """Process readings [deg/s] and counts [deg; NaN if unknown] at the next ticks, (n, 2)."""
        if not self._start_ns:
            self._start_ns = self._settled_ns = self.now_ns = int(stamps_ns[0])
        count = len(stamps_ns)
        seconds = np.diff(stamps_ns, prepend=self.now_ns) / SECOND_NS
        self.now_ns = int(stamps_ns[-1])
        track = np.empty((count, 2, 5))
        track[:, :, 4] = encoders
        begin = int(np.searchsorted(stamps_ns, self._start_ns + CALIBRATION_NS))
        if begin:
            self._settled_ns = int(stamps_ns[begin - 1])
            for plane, pitch in enumerate(self._planes):
                for reading in gyro[:begin, plane].tolist():
                    pitch.calibrate(reading)
                track[:begin, plane, :4] = pitch.values
        while begin < count:
            due_ns = self._settled_ns + _TILT_PERIOD_NS
            end = min(int(np.searchsorted(stamps_ns, due_ns)) + 1, count)
            last_ns, part = int(stamps_ns[end - 1]), slice(begin, end)
            for plane, pitch in enumerate(self._planes):
                track[part, plane, 2:4] = pitch.variance, pitch.rate_variance
                track[part, plane, :2] = pitch.integrate(gyro[part, plane], seconds[part]).T
                if last_ns >= due_ns:
                    pitch.settle((last_ns - self._settled_ns) / SECOND_NS)
                    track[end - 1, plane, :4] = pitch.values
            if last_ns >= due_ns:
                self._settled_ns = last_ns
            begin = end
        self._newest = len(self._stamps[-_KEPT:])
        self._stamps = np.concatenate([self._stamps[-_KEPT:], stamps_ns])
        self._track = np.concatenate([self._track[-_KEPT:], track])

    def is_calibrated(self, rows: Rows | int) -> Any:
        """Return whether the offsets of the gyros are known at some of the newest ticks."""
        return self._stamps[rows + self._newest] >= self._start_ns + CALIBRATION_NS

    def state(self, rows: Rows | int) -> OdometryState:
        """Return the state at some of the newest ticks, whose counts are known, or at one."""
        now = rows + self._newest
        then = np.maximum(now - _KEPT, 0)
        seconds = np.maximum(self._stamps[now] - self._stamps[then], TICK_NS) / SECOND_NS
        pitch, rate, variance, rate_variance, counts = self._track[now].T
        pitch_then, *_, counts_then = self._track[then].T
        counts_then = np.where(np.isnan(counts_then), counts, counts_then)
        begin, end = self._position(counts_then, pitch_then), self._position(counts, pitch)
        motor = _square(self._wheel_radius * _RADIANS) * (_ROUNDING + _GEAR_PLAY)
        body = _square(self._ball_radius * _RADIANS)
        # The pitch at the start, which the encoders do not see, is as uncertain as any.
        still = motor + body * (variance + _TILT_VARIANCE)
        moving = 2.0 * motor / _square(seconds) + _square(_ACCELERATION * seconds / 2.0)
        return OdometryState(
            Estimate(end, still),
            Estimate((end - begin) / seconds, np.array([moving, moving])),
            _in_radians(pitch, variance),
            _in_radians(rate, rate_variance + _AGE),
        )

    def _position(self, motor: Floats, pitch: Floats) -> Floats:
        """Return Rs theta [m]; Rs theta_m / k is Rw theta_m."""
        return self._wheel_radius * _RADIANS * motor + self._ball_radius * _RADIANS * pitch


def _square(value: Any) -> Any:
    return value * value


def _in_radians(value: Floats, variance: Floats) -> Estimate:
    return Estimate(value * _RADIANS, variance * _square(_RADIANS))
