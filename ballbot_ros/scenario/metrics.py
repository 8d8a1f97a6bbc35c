"""Metrics of a run's motion, for expectations."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ballbot_ros.scenario.metric_registry import MetricRegistry

Floats = NDArray[np.float64]
Clearance = Callable[[Floats], Floats]
"""Distances [m] from the body's outline to a wall at positions (n, 2) in plane signs."""

SETTLED_DEG = 1.0
_CLEARANCE_STRIDE = 5


@dataclass(frozen=True)
class Motion:
    """The measured part of a run, at least one tick; column 0 is plane x, 1 plane y.

    A column that was not recorded is all NaN, and so is every metric that depends on it.

    Attributes
    ----------
    time : ndarray, shape (n,)
        Time since the first tick of the run [s].
    position : ndarray, shape (n, 2)
        Ball centre [m].
    psi : ndarray, shape (n, 2)
        Body pitch [rad].
    duty : ndarray, shape (n, 2)
        Duty [%].
    start : ndarray, shape (2,)
        Ball centre at the start of the run [m].
    clearance : callable or None
        Returns the distances to the walls; None if there are no walls.
    """

    time: Floats
    position: Floats
    psi: Floats
    duty: Floats
    start: Floats
    clearance: Clearance | None

    # The properties are computed on every access: in a run of hours, keeping them would cost more
    # memory than computing them costs time.
    @property
    def pitch(self) -> Floats:
        """Body pitch [°], shape (n, 2)."""
        return np.degrees(self.psi)

    @property
    def second_half(self) -> slice:
        """The ticks of the second half, after the transient."""
        return slice(np.searchsorted(self.time, (self.time[0] + self.time[-1]) / 2.0), None)

    @property
    def distance(self) -> Floats:
        """Distance of the ball from its start [m], shape (n,)."""
        return _length(self.position - self.start)

    @property
    def steps(self) -> Floats:
        """Distance of the ball from tick to tick [m], shape (n - 1,)."""
        return _length(np.diff(self.position, axis=0))

    @property
    def distance_from_mean(self) -> Floats:
        """Distance of the ball from its mean position in the second half [m], shape (m,)."""
        position = self.position[self.second_half]
        return _length(position - position.mean(axis=0))


METRICS = MetricRegistry[Motion]()
"""The metrics for expectations; they cover the motion from the release, the end of `hold_time`."""


@METRICS.metric(f'time until both pitches stay within ±{SETTLED_DEG:g}°')
def settling_time_s(motion: Motion) -> float:
    """Return the time from the first tick until the pitches stay within the band."""
    pitch = motion.pitch
    if np.isnan(pitch).any():
        return math.nan
    outside = np.flatnonzero(np.abs(pitch).max(axis=1) > SETTLED_DEG)
    if outside.size == 0:
        return 0.0
    last = outside[-1]
    if last == len(motion.time) - 1:
        return math.nan
    return float(motion.time[last + 1] - motion.time[0])


@METRICS.metric('largest body pitch of either plane')
def peak_pitch_deg(motion: Motion) -> float:
    return float(np.abs(motion.pitch).max())


@METRICS.metric('root mean square of both pitches over the second half')
def steady_pitch_rms_deg(motion: Motion) -> float:
    return _rms(motion.pitch[motion.second_half])


@METRICS.metric("root mean square of the ball's distance from its start")
def position_rms_m(motion: Motion) -> float:
    return _rms(motion.distance)


@METRICS.metric('largest distance of the ball from its start')
def peak_position_m(motion: Motion) -> float:
    return float(motion.distance.max())


@METRICS.metric('how far the ball overshoots its final position, coming from its farthest point')
def overshoot_m(motion: Motion) -> float:
    """Return how far [m] the ball overshoots its final position, from its farthest point.

    On a drive to a new position the farthest point is the start; on a swing back to the start, the
    turning point.
    """
    beyond = motion.position - motion.position[-1]
    distance = _length(beyond)
    farthest = int(np.argmax(distance))
    if not distance[farthest]:
        return 0.0
    direction = -beyond[farthest] / distance[farthest]
    return float((beyond[farthest:] @ direction).max())


@METRICS.metric("root mean square of the ball's distance from its mean position, second half")
def station_rms_m(motion: Motion) -> float:
    return _rms(motion.distance_from_mean)


@METRICS.metric('largest distance of the ball from its mean position, second half')
def station_radius_m(motion: Motion) -> float:
    return float(motion.distance_from_mean.max())


@METRICS.metric('position on plane x at the end, from the start')
def final_position_x_m(motion: Motion) -> float:
    return float(motion.position[-1, 0] - motion.start[0])


@METRICS.metric('position on plane y at the end, from the start')
def final_position_y_m(motion: Motion) -> float:
    return float(motion.position[-1, 1] - motion.start[1])


@METRICS.metric("length of the ball's path")
def distance_driven_m(motion: Motion) -> float:
    return float(motion.steps.sum())


@METRICS.metric('largest speed of the ball')
def peak_speed_m_per_s(motion: Motion) -> float:
    return float((motion.steps / np.diff(motion.time)).max(initial=0.0))


@METRICS.metric("smallest distance from the body's outline to a wall, to about 1 cm")
def wall_clearance_m(motion: Motion) -> float:
    if motion.clearance is None:
        return math.nan
    return float(motion.clearance(motion.position[::_CLEARANCE_STRIDE]).min())


@METRICS.metric('root mean square of the duties of both motors')
def duty_rms_percent(motion: Motion) -> float:
    return _rms(motion.duty)


@METRICS.metric('share of duties that are at ±100 %')
def duty_saturated_share(motion: Motion) -> float:
    return float(np.where(np.isnan(motion.duty), math.nan, np.abs(motion.duty) >= 100.0).mean())


def _length(vectors: Floats) -> Floats:
    return np.hypot(vectors[:, 0], vectors[:, 1])


def _rms(values: Floats) -> float:
    return math.sqrt(float(np.mean(np.square(values))))
