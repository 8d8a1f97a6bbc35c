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
from collections import deque
from typing import NamedTuple

from ballbot_ros.parameters.timing import SECOND_NS, TICK_NS

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


_RADIANS = math.pi / 180.0

Pair = tuple[float, float]
"""A value of plane x and one of plane y, in plane signs."""


class Estimate(NamedTuple):
    """A quantity of both planes, with its variances."""

    value: Pair
    variance: Pair


class OdometryState(NamedTuple):
    """The robot's motion as it measures it.

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

    def integrate(self, reading: int, seconds: float) -> None:
        """Turn on by a reading [deg/s] for some time."""
        self.rate = reading - self._offset
        self.pitch += self.rate * seconds

    def settle(self, seconds: float) -> None:
        """Let the uncertainty grow for some time, and weigh the pitch with its mean of zero."""
        noise = (self.rate_variance - self._offset_variance) * seconds * TICK_NS / SECOND_NS
        self.variance += (
            -2.0 * self._covariance * seconds + self._offset_variance * seconds * seconds + noise
        )
        self._covariance -= self._offset_variance * seconds
        self._offset_variance += _DRIFT * seconds
        if abs(self.pitch) < _FALLING:
            self._correct()

    def _correct(self) -> None:
        innovation = self.variance + _TILT_VARIANCE
        gain, offset_gain = self.variance / innovation, self._covariance / innovation
        self._offset -= offset_gain * self.pitch
        self.pitch -= gain * self.pitch
        self._offset_variance -= offset_gain * self._covariance
        self._covariance *= 1.0 - gain
        self.variance *= 1.0 - gain


class DeadReckoning:
    """Estimates the robot's motion from the readings of gyros and encoders.

    Parameters
    ----------
    ball_radius, wheel_radius : float
        Rs and Rw [m].

    Attributes
    ----------
    now_ns : int
        Stamp of the newest reading [ns]; 0 before the first.
    """

    def __init__(self, ball_radius: float, wheel_radius: float) -> None:
        self._ball_radius, self._wheel_radius = ball_radius, wheel_radius
        self._planes = (_Pitch(), _Pitch())
        self._start_ns = self._settled_ns = self.now_ns = 0
        self._pitches: deque[tuple[int, float, float]] = deque(maxlen=WINDOW_NS // TICK_NS + 1)

    @property
    def then_ns(self) -> int:
        """Begin of the time over which the velocity is measured [ns]."""
        return self._pitches[0][0]

    @property
    def is_calibrated(self) -> bool:
        """Whether the offsets of the gyros are known."""
        return self.now_ns >= self._start_ns + CALIBRATION_NS

    def add(self, stamp_ns: int, gyro: tuple[int, int]) -> None:
        """Process the readings of the gyros [deg/s] at a tick, which follows the one before."""
        if not self._start_ns:
            self._start_ns = self._settled_ns = self.now_ns = stamp_ns
        seconds = (stamp_ns - self.now_ns) / SECOND_NS
        self.now_ns = stamp_ns
        x, y = self._planes
        if stamp_ns < self._start_ns + CALIBRATION_NS:
            x.calibrate(gyro[0])
            y.calibrate(gyro[1])
            self._settled_ns = stamp_ns
        else:
            x.integrate(gyro[0], seconds)
            y.integrate(gyro[1], seconds)
            if stamp_ns >= self._settled_ns + _TILT_PERIOD_NS:
                x.settle((stamp_ns - self._settled_ns) / SECOND_NS)
                y.settle((stamp_ns - self._settled_ns) / SECOND_NS)
                self._settled_ns = stamp_ns
        self._pitches.append((stamp_ns, x.pitch, y.pitch))

    def state(self, then: tuple[int, int], now: tuple[int, int]) -> OdometryState:
        """Return the state for the counts of the encoders [deg] at `then_ns` and at `now_ns`."""
        seconds = max(self.now_ns - self.then_ns, TICK_NS) / SECOND_NS
        x, y = self._planes
        begin, end = self._position(then, self._pitches[0]), self._position(now, self._pitches[-1])
        motor = _square(self._wheel_radius * _RADIANS) * (_ROUNDING + _GEAR_PLAY)
        body = _square(self._ball_radius * _RADIANS)
        # The pitch at the start, which the encoders do not see, is as uncertain as any.
        still = (
            motor + body * (x.variance + _TILT_VARIANCE),
            motor + body * (y.variance + _TILT_VARIANCE),
        )
        moving = 2.0 * motor / _square(seconds) + _square(_ACCELERATION * seconds / 2.0)
        speed = (end[0] - begin[0]) / seconds, (end[1] - begin[1]) / seconds
        return OdometryState(
            Estimate(end, still),
            Estimate(speed, (moving, moving)),
            _in_radians((x.pitch, y.pitch), (x.variance, y.variance)),
            _in_radians((x.rate, y.rate), (x.rate_variance, y.rate_variance)),
        )

    def _position(self, motor: tuple[int, int], pitch: tuple[int, float, float]) -> Pair:
        """Return Rs theta [m]; Rs theta_m / k is Rw theta_m."""
        ball, wheel = self._ball_radius * _RADIANS, self._wheel_radius * _RADIANS
        return wheel * motor[0] + ball * pitch[1], wheel * motor[1] + ball * pitch[2]


def _square(value: float) -> float:
    return value * value


def _in_radians(value: Pair, variance: Pair) -> Estimate:
    x, y = value
    variance_x, variance_y = variance
    square = _square(_RADIANS)
    return Estimate((x * _RADIANS, y * _RADIANS), (variance_x * square, variance_y * square))
