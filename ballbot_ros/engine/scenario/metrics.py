"""Metrics of a run's motion, for expectations.

The functions can be compiled by numba without changes.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Generic, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from ballbot_ros.engine.scenario.task_timing import DUTY_AGE_US, LOST, RESPONSE_US, SHARE
from ballbot_ros.robot.arithmetic import Floats
from ballbot_ros.robot.world.clearance import Walls, clearance

Measured = TypeVar('Measured')
"""What a metric is computed from."""

Function = Callable[[Measured], float]


@dataclass(frozen=True)
class Metric(Generic[Measured]):
    """A metric: its meaning, and the function that computes it, with NaN for missing data."""

    meaning: str
    compute: Function[Measured]


class MetricRegistry(dict[str, Metric[Measured]]):
    """Metrics by name, in order of definition."""

    def metric(
        self, meaning: str, name: str = ''
    ) -> Callable[[Function[Measured]], Function[Measured]]:
        """Register the decorated function as a metric.

        The `name`, by default the function's, ends in the metric's unit.
        """

        def register(compute: Function[Measured]) -> Function[Measured]:
            self[name or compute.__name__] = Metric(meaning, compute)
            return compute

        return register

    def measure(self, measured: Measured) -> dict[str, float]:
        """Return the values of all metrics."""
        return {name: float(metric.compute(measured)) for name, metric in self.items()}

    @property
    def meanings(self) -> Mapping[str, str]:
        """Meaning of each metric, by name."""
        return {name: metric.meaning for name, metric in self.items()}


UNITS: Mapping[str, str] = {
    'm_per_s': 'm/s',
    'deg_per_s': '°/s',
    'ms': 'ms',
    's': 's',
    'deg': '°',
    'm': 'm',
    'percent': '%',
    'j': 'J',
    'v': 'V',
    'hz': 'Hz',
}
"""Units by the endings of metric names, longer endings first."""


_FROM_THE_START: Mapping[str, str] = {
    'position_rms': 'distance from start rms',
    'peak_position': 'peak distance from start',
    'final_position_x': 'final x from start',
    'final_position_y': 'final y from start',
}
"""Labels of metrics that count from the start: a position counts from the origin of ``map``."""


def label(name: str) -> tuple[str, str]:
    """Return a metric's name as text, and its unit; a pure number has no unit."""
    for ending, unit in UNITS.items():
        if name.endswith(f'_{ending}'):
            words = name.removesuffix(f'_{ending}')
            return _FROM_THE_START.get(words, words.replace('_', ' ')), unit
    return name.replace('_', ' '), ''


SETTLED_DEG = 1.0
_SETTLED_RAD = math.radians(SETTLED_DEG)
_CLEARANCE_STRIDE = 5


class Motion(NamedTuple):
    """The measured part of a run, at least one tick; column 0 is plane x, 1 plane y.

    A column that was not recorded is all NaN, and so is every metric that depends on it. `timing`
    has no rows if the tasks of the brick take no time.

    Attributes
    ----------
    time : ndarray, shape (n,)
        Time since the first tick of the run [s].
    position : ndarray, shape (n, 2)
        Ball centre [m].
    psi : ndarray, shape (n, 2)
        Body pitch [rad].
    duty : ndarray of int8 or float64, shape (n, 2)
        Duty [%].
    start : ndarray, shape (2,)
        Ball centre at the start of the run [m].
    walls : Walls
        :data:`~ballbot_ros.robot.world.clearance.NO_WALLS` if there are none.
    timing : ndarray, shape (n, 4) or (0, 4)
        The columns of :mod:`~ballbot_ros.engine.scenario.task_timing`.
    """

    time: Floats
    position: Floats
    psi: Floats
    duty: NDArray[np.int8] | Floats
    start: Floats
    walls: Walls
    timing: Floats


METRICS = MetricRegistry[Motion]()
"""The metrics for expectations; they cover the motion from the release, the end of `hold_time`."""


@METRICS.metric(f'time until both pitches stay within ±{SETTLED_DEG:g}°')
def settling_time_s(motion: Motion) -> float:
    """Return the time from the first tick until the pitches stay within the band."""
    pitch = np.maximum(np.abs(motion.psi[:, 0]), np.abs(motion.psi[:, 1]))
    if np.isnan(pitch).any():
        return math.nan
    outside = np.flatnonzero(pitch > _SETTLED_RAD)
    if outside.size == 0:
        return 0.0
    last = outside[-1]
    if last == len(motion.time) - 1:
        return math.nan
    return float(motion.time[last + 1] - motion.time[0])


@METRICS.metric('largest body pitch of either plane')
def peak_pitch_deg(motion: Motion) -> float:
    x, y = motion.psi[:, 0], motion.psi[:, 1]
    return math.degrees(np.max(np.maximum(np.abs(x), np.abs(y))))


@METRICS.metric('root mean square of both pitches over the second half')
def steady_pitch_rms_deg(motion: Motion) -> float:
    half = middle(motion.time)
    return math.degrees(rms_of_both(motion.psi[half:, 0], motion.psi[half:, 1]))


@METRICS.metric("root mean square of the ball's distance from its start")
def position_rms_m(motion: Motion) -> float:
    return math.sqrt(np.mean(squared_distances(motion.position, motion.start[0], motion.start[1])))


@METRICS.metric('largest distance of the ball from its start')
def peak_position_m(motion: Motion) -> float:
    return math.sqrt(np.max(squared_distances(motion.position, motion.start[0], motion.start[1])))


@METRICS.metric('how far the ball overshoots its final position, coming from its farthest point')
def overshoot_m(motion: Motion) -> float:
    """Return how far [m] the ball overshoots its final position, from its farthest point.

    On a drive to a new position the farthest point is the start; on a swing back to the start, the
    turning point.
    """
    x = motion.position[:, 0] - motion.position[-1, 0]
    y = motion.position[:, 1] - motion.position[-1, 1]
    squares = x * x + y * y
    farthest = np.argmax(squares)
    distance = math.sqrt(squares[farthest])
    if distance == 0.0:
        return 0.0
    along_x, along_y = -x[farthest] / distance, -y[farthest] / distance
    # Adding zero makes 0 of -0, which is the product of the final position, if it is the maximum.
    return float(np.max(x[farthest:] * along_x + y[farthest:] * along_y) + 0.0)


@METRICS.metric("root mean square of the ball's distance from its mean position, second half")
def station_rms_m(motion: Motion) -> float:
    return math.sqrt(np.mean(squared_distances_from_mean(motion.position[middle(motion.time) :])))


@METRICS.metric('largest distance of the ball from its mean position, second half')
def station_radius_m(motion: Motion) -> float:
    return math.sqrt(np.max(squared_distances_from_mean(motion.position[middle(motion.time) :])))


@METRICS.metric('how far forward of its start the ball is at the end (plane x)')
def final_position_x_m(motion: Motion) -> float:
    return float(motion.position[-1, 0] - motion.start[0])


@METRICS.metric('how far right of its start the ball is at the end (plane y)')
def final_position_y_m(motion: Motion) -> float:
    return float(motion.position[-1, 1] - motion.start[1])


@METRICS.metric("length of the ball's path")
def distance_driven_m(motion: Motion) -> float:
    return float(np.sum(np.sqrt(squared_steps(motion.position))))


@METRICS.metric('largest speed of the ball')
def peak_speed_m_per_s(motion: Motion) -> float:
    periods = motion.time[1:] - motion.time[:-1]
    if periods.size == 0:
        return 0.0
    return math.sqrt(np.max(squared_steps(motion.position) / (periods * periods)))


@METRICS.metric("smallest distance from the body's outline to a wall, to about 1 cm")
def wall_clearance_m(motion: Motion) -> float:
    if motion.walls.distance.size == 0:
        return math.nan
    return float(np.min(clearance(motion.walls, motion.position[::_CLEARANCE_STRIDE])))


@METRICS.metric('root mean square of the duties of both motors')
def duty_rms_percent(motion: Motion) -> float:
    return rms_of_both(as_floats(motion.duty[:, 0]), as_floats(motion.duty[:, 1]))


@METRICS.metric('share of duties that are at ±100 %')
def duty_saturated_share(motion: Motion) -> float:
    x, y = as_floats(motion.duty[:, 0]), as_floats(motion.duty[:, 1])
    if np.isnan(x + y).any():
        return math.nan
    saturated = np.count_nonzero(np.abs(x) >= 100.0) + np.count_nonzero(np.abs(y) >= 100.0)
    return float(saturated / (2.0 * len(x)))


@METRICS.metric(
    'longest time from the release of a job that sets the duty to its end; needs kernel or link'
)
def response_time_ms(motion: Motion) -> float:
    return longest_ms(motion.timing[:, RESPONSE_US])


@METRICS.metric('alarms lost because their task was still active, of all tasks')
def lost_jobs(motion: Motion) -> float:
    return float(np.sum(motion.timing[:, LOST])) if len(motion.timing) else math.nan


@METRICS.metric('share of the processor that jobs, interrupts and the bus take')
def utilisation(motion: Motion) -> float:
    return float(np.mean(motion.timing[:, SHARE])) if len(motion.timing) else math.nan


@METRICS.metric('longest time from the samples that a new duty is computed from until it acts')
def duty_age_ms(motion: Motion) -> float:
    """Return the age [ms] of :func:`~ballbot_ros.engine.scenario.task_timing.duty_age`."""
    return longest_ms(motion.timing[:, DUTY_AGE_US])


OF_TASKS = 'response_time_ms', 'lost_jobs', 'utilisation', 'duty_age_ms'
"""Metrics without a value if the tasks of the brick take no time."""


def lacks_times(name: str, value: float) -> bool:
    """Return whether a metric is one of tasks that take no time: it says nothing of the run."""
    return name in OF_TASKS and math.isnan(value)


def longest_ms(times_us: Floats) -> float:
    """Return the longest time [ms]; NaN if there is none, so that all are NOT_YET."""
    longest_us = np.max(times_us) if len(times_us) else math.nan
    return float(longest_us * 1e-3) if longest_us >= 0.0 else math.nan


def as_floats(duty: NDArray[np.int8] | Floats) -> Floats:
    """Return duties as floats: the square of an int8 overflows."""
    return duty.astype(np.float64)


def middle(time: Floats) -> int:
    """Return the first tick of the second half, after the transient."""
    return int(np.searchsorted(time, (time[0] + time[-1]) / 2.0))


def squared_distances(position: Floats, x: float, y: float) -> Floats:
    """Return the squared distances [m²], (n,), of positions (n, 2) [m] from the position x, y."""
    # Squares, because their roots would take longer to compute than all the rest.
    to_x: Floats = position[:, 0] - x
    to_y: Floats = position[:, 1] - y
    return to_x * to_x + to_y * to_y


def squared_distances_from_mean(position: Floats) -> Floats:
    """Return the squared distances [m²], (n,), of positions (n, 2) [m] from their mean."""
    return squared_distances(
        position, float(np.mean(position[:, 0])), float(np.mean(position[:, 1]))
    )


def squared_steps(position: Floats) -> Floats:
    """Return the squared distances [m²] from tick to tick, (n - 1,), of positions (n, 2) [m]."""
    x: Floats = position[1:, 0] - position[:-1, 0]
    y: Floats = position[1:, 1] - position[:-1, 1]
    return x * x + y * y


def rms_of_both(x: Floats, y: Floats) -> float:
    """Return the root mean square of the values of both planes, each (n,)."""
    return math.sqrt(np.mean(x * x + y * y) / 2.0)
