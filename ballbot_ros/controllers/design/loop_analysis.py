"""Analysis of a loop: stability margins, noise, and the states that can be recovered.

The upright robot has one unstable pole p. Its motion z = w·x grows as ``z' = p z + (w·b) v``, with
the left eigenvector w of p. The voltage v is bounded, so z can be brought back if and only if
``p |z| < |w·b| v_max``: beyond that, it grows even under full duty. The other poles do not grow and
set no limit. So the states that can be recovered are a strip between two parallel planes.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, NamedTuple

import control
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq, minimize_scalar

from ballbot_ros.controllers.design.linear_model import DesignError, ideal_loop
from ballbot_ros.controllers.design.sampled_loop import ENCODER_ERROR, GYRO_ERROR, SampledLoop
from ballbot_ros.controllers.document.program import mean_delays
from ballbot_ros.parameters import CONTROLLER, ControllerParameters, ParameterSet, PlantParameters
from ballbot_ros.parameters.timing import TICK_MS
from ballbot_ros.robot.plant.laws import motor_voltage
from ballbot_ros.robot.plant.model import Matrix, PhysicalParameters, state_space

FADED = 1e-30
"""Part of a motion below which nothing is left of it."""


def steady_covariance(a: Matrix, noise: Matrix) -> Matrix:
    """Return the covariance (n, n) of the states of ``x[k+1] = a x[k] + w[k]``.

    It is the sum of ``a^k noise a'^k`` over all k, found by doubling their number: the states of a
    loop differ by orders of magnitude, and a solver of Lyapunov's equation loses digits with them.
    The transition (n, n) is stable; the noise (n, n) is the covariance of w.
    """
    power, covariance = a, noise
    while np.abs(power).max() > FADED:
        covariance = covariance + power @ covariance @ power.T
        power = power @ power
    return covariance


Response = NDArray[np.complex128]

POINTS = 2000
"""Number of frequencies of a response; crossings and peaks are refined between them."""

LOWEST, HIGHEST = 1e-3, 1e5
"""Range of the frequencies [rad/s]; that of a sampled loop ends at half the sampling rate."""


class Limit(NamedTuple):
    """A change at which a loop begins to oscillate, and the frequency of that [Hz]."""

    value: float
    hz: float


@dataclass(frozen=True)
class Margins:
    """How much may change before a stable loop becomes unstable.

    Attributes
    ----------
    gain_low, gain_high : Limit
        Factors of the gain between which it stays stable; 0 and infinity without a limit.
    phase_deg : Limit
        Additional phase, lag or lead [deg].
    dead_time_ms : Limit
        Additional dead time of the motors [ms].
    disk : float
        Balanced disk margin, for a change of gain and phase at the same time.
    sensitivity : Limit
        Peak of the sensitivity, the inverse of the loop's distance from -1.
    """

    gain_low: Limit
    gain_high: Limit
    phase_deg: Limit
    dead_time_ms: Limit
    disk: float
    sensitivity: Limit


class LoopResponse:
    """The frequency response L of a loop that negative feedback closes.

    It has `values` at `frequencies` [rad/s], both of the shape (n,).
    """

    def __init__(self, loop: control.StateSpace) -> None:
        self._loop, self._dt = loop, float(loop.dt)
        highest = math.pi / self._dt if self._dt else HIGHEST
        self.frequencies: NDArray[np.float64] = np.geomspace(LOWEST, highest, POINTS)
        self.values = self._at(self.frequencies)

    def _at(self, frequency: NDArray[np.float64] | float) -> Response:
        s = 1j * np.asarray(frequency)
        return np.asarray(self._loop(np.exp(s * self._dt) if self._dt else s))

    def margins(self, dead_time_ms: Limit | None = None) -> Margins:
        """Return the margins of the loop, which must be stable.

        Without `dead_time_ms`, that margin is computed as in continuous time.
        """
        gains = [Limit(0.0, math.nan), Limit(math.inf, math.nan), *self._gains()]
        phases = self._phases() or [Limit(math.inf, math.nan)]
        delays = [Limit(phase % 360.0 / 360.0 / hz * 1e3, hz) for phase, hz in phases]
        disk, _, _ = control.disk_margins(self._loop, self.frequencies)
        return Margins(
            gain_low=max(each for each in gains if each.value < 1.0),
            gain_high=min(each for each in gains if each.value > 1.0),
            phase_deg=min((Limit(abs(phase), hz) for phase, hz in phases)),
            dead_time_ms=dead_time_ms or min(delays),
            disk=float(disk),
            sensitivity=self._sensitivity_peak(),
        )

    def _gains(self) -> list[Limit]:
        """Return the factors of the gain at which the loop oscillates."""
        crossings = self._roots(lambda response: response.imag)
        if self._dt:
            crossings.append(float(self.frequencies[-1]))  # there, a sampled response is real
        found = ((self._at(each).item().real, each) for each in crossings)
        return [Limit(-1.0 / value, _hz(frequency)) for value, frequency in found if value < 0.0]

    def _phases(self) -> list[Limit]:
        """Return the phase lags (> 0) and leads (< 0) at which the loop oscillates [deg]."""
        crossings = self._roots(lambda response: abs(response) - 1.0)
        return [Limit(float(np.angle(-self._at(each), deg=True)), _hz(each)) for each in crossings]

    def _sensitivity_peak(self) -> Limit:
        def distance(frequency: float) -> float:
            return float(abs(1.0 + self._at(frequency)))

        nearest = int(np.argmin(abs(1.0 + self.values)))
        first, last = max(nearest - 1, 0), min(nearest + 1, POINTS - 1)
        bounds = self.frequencies[first], self.frequencies[last]
        best = minimize_scalar(distance, bounds=bounds, method='bounded').x
        frequency = min(best, self.frequencies[nearest], key=distance)
        return Limit(1.0 / distance(frequency), _hz(frequency))

    def _roots(self, quantity: Callable[[Response], NDArray[Any]]) -> list[float]:
        """Return the frequencies at which a quantity of the response changes its sign."""
        signs = np.sign(quantity(self.values))
        return [
            brentq(lambda w: float(quantity(self._at(w))), *self.frequencies[index : index + 2])
            for index in np.flatnonzero(signs[1:] * signs[:-1] < 0)
        ]


def _hz(frequency: float) -> float:
    return float(frequency) / (2.0 * math.pi)


@dataclass(frozen=True)
class RecoverableStates:
    """The states of a plane that some controller can bring back, by the linear model.

    Attributes
    ----------
    rate : float
        The unstable pole [1/s].
    direction : ndarray, shape (4,)
        Factors of theta, psi [rad] and their rates [rad/s]; their sum is 1 or -1 at the limit.
    """

    rate: float
    direction: Matrix

    def share(self, states: Matrix) -> Matrix:
        """Return how much of what can be recovered the states (..., 4) take; 1 at the limit."""
        return np.asarray(np.abs(states @ self.direction))


def recoverable_states(parameters: ParameterSet) -> RecoverableStates:
    """Return the states that can be recovered with the battery's voltage at the start.

    It raises DesignError if the robot has not exactly one unstable pole, or its motors can't move
    it.
    """
    plant = parameters.of(PlantParameters)
    a, b = state_space(PhysicalParameters.from_parameters(plant))
    values, vectors = np.linalg.eig(a.T)
    unstable = np.flatnonzero(values.real > 0.0)
    if len(unstable) != 1:
        raise DesignError(f'the robot has {len(unstable)} unstable poles instead of 1')
    rate, direction = values[unstable[0]].real, vectors[:, unstable[0]].real
    volts = motor_voltage(
        100, plant.battery_voltage, plant.dead_zone, plant.voltage_slope, plant.voltage_offset
    )
    limit = abs(direction @ b[:, 0]) * volts / rate
    if not limit:
        raise DesignError('the motors cannot move the robot')
    # The sign of an eigenvector is arbitrary.
    return RecoverableStates(float(rate), direction / limit * np.sign(direction[1]))


MAX_DEAD_TIME_MS = 1000.0
"""Longest additional dead time that is tried; a loop that bears it counts as without a limit."""

MIN_STEP_MS, RELATIVE_STEP = 0.25, 0.05
"""Steps of the dead times that are tried."""

GONE = 1e-3
"""Magnitude below which the motion of a sampled pole is over after a tick."""

STEADY = 1e-6
"""Rate of decay below which a motion counts as one that never ends [1/s]."""

RINGING = 0.1
"""Damping ratio below which a loop rings."""

ROUNDING = math.sqrt(1.0 / 12.0)
"""Standard deviation of the error of a number rounded to an integer."""


class Pole(NamedTuple):
    """A pole and its motion.

    Attributes
    ----------
    value : complex
        In the s plane [1/s], or in the z plane of a sampled loop.
    hz : float
        Natural frequency [Hz].
    oscillation_hz : float
        Frequency at which it oscillates [Hz], 0 if it does not.
    damping : float
        Damping ratio; 1 if it does not oscillate, negative if it grows.
    decay : float
        Rate of its decay [1/s], negative if it grows.
    """

    value: complex
    hz: float
    oscillation_hz: float
    damping: float
    decay: float

    @property
    def is_stable(self) -> bool:
        """Whether its motion ends."""
        return self.decay > STEADY

    @property
    def is_growing(self) -> bool:
        """Whether its motion grows."""
        return self.decay < -STEADY

    @classmethod
    def of(cls, value: complex, dt: float = 0.0) -> Pole:
        """Return a pole in the s plane, or, with a sampling period `dt` [s], in the z plane."""
        s = cmath.log(value) / dt if dt else value
        return cls(
            value,
            hz=abs(s) / (2.0 * math.pi),
            oscillation_hz=abs(s.imag) / (2.0 * math.pi),
            damping=-s.real / abs(s) if s else 0.0,
            decay=-s.real,
        )


@dataclass(frozen=True)
class SampleAnalysis:
    """What the loop makes of the errors and ages of its samples.

    Attributes
    ----------
    gyro_noise, encoder_noise : float
        Standard deviation of the duty [%] for white noise with that of one count, 1 deg/s or 1 deg.
    gyro_dead_time_ms, encoder_dead_time_ms : Limit
        Additional age of the samples [ms] at which the loop oscillates.
    """

    gyro_noise: float
    encoder_noise: float
    gyro_dead_time_ms: Limit
    encoder_dead_time_ms: Limit

    @property
    def rounding_noise(self) -> float:
        """That of samples rounded to whole counts, if all errors are independent of each other."""
        return ROUNDING * math.hypot(self.gyro_noise, self.encoder_noise)


@dataclass(frozen=True)
class LoopAnalysis:
    """Properties of a closed loop; its poles are from slow to fast.

    An unstable loop has neither margins nor samples, and one in continuous time no samples.
    """

    poles: tuple[Pole, ...]
    margins: Margins | None
    samples: SampleAnalysis | None = None

    @property
    def ringing(self) -> Pole | None:
        """The least damped of the stable poles that ring; None if there is none."""
        rings = [pole for pole in self.poles if pole.is_stable and pole.damping < RINGING]
        return min(rings, key=lambda pole: pole.damping, default=None)

    @property
    def unstable(self) -> Pole | None:
        """The pole that grows fastest, or never decays; None if the loop is stable."""
        others = [pole for pole in self.poles if not pole.is_stable]
        return min(others, key=lambda pole: pole.decay, default=None)


def analyse_ideal(parameters: ParameterSet) -> LoopAnalysis:
    """Analyse the loop of section 4.2: the gains in use on all states, in continuous time."""
    loop = ideal_loop(parameters)
    poles = sorted_poles(np.linalg.eigvals(loop.A - loop.B @ loop.C))
    is_stable = all(pole.is_stable for pole in poles)
    return LoopAnalysis(poles, LoopResponse(loop).margins() if is_stable else None)


def analyse_sampled(parameters: ParameterSet, period_ms: float = TICK_MS) -> LoopAnalysis:
    """Analyse the loop as it runs, as a :class:`SampledLoop` with a period of task_ts1.

    It raises DesignError if the controller is not the document's program.
    """
    loop = SampledLoop(parameters, period_ms=period_ms)
    poles = sorted_poles(loop.poles(), loop.period_s)
    if not all(pole.is_stable for pole in poles):
        return LoopAnalysis(poles, None)
    dead_time = partial(_dead_time_margin, loop)
    return LoopAnalysis(
        poles,
        LoopResponse(loop.open_loop()).margins(dead_time('actuator')),
        SampleAnalysis(
            gyro_noise=_noise(loop, GYRO_ERROR),
            encoder_noise=_noise(loop, ENCODER_ERROR),
            gyro_dead_time_ms=dead_time('gyro'),
            encoder_dead_time_ms=dead_time('encoder'),
        ),
    )


def dead_time_margin_ms(parameters: ParameterSet) -> float:
    """Return the additional dead time of the motors [ms] at which the loop as it runs oscillates.

    It is that of :func:`analyse_sampled`, with its error, without the rest of the analysis: 0 if
    the loop is unstable, infinite without a limit.
    """
    loop = SampledLoop(parameters)
    is_stable = all(pole.is_stable for pole in sorted_poles(loop.poles(), loop.period_s))
    return _dead_time_margin(loop, 'actuator').value if is_stable else 0.0


def brick_dead_time(parameters: ParameterSet) -> tuple[float, float]:
    """Return the dead time that the loop bears, and the one that a brick has [ms].

    The first is that of the motors, 0 if the loop is not stable; the second is the sum of the mean
    ages of gyro readings and duties, which does not depend on the phase of the link.
    """
    ideal, brick = ParameterSet(parameters), ParameterSet(parameters)
    for each, is_brick in ((ideal, False), (brick, True)):
        each.set(CONTROLLER, 'implementation', 'python')
        for name in ('kernel', 'link'):
            each.set(CONTROLLER, name, is_brick)
    return dead_time_margin_ms(ideal), sum(mean_delays(brick.of(ControllerParameters)))


def sorted_poles(values: Iterable[complex], dt: float = 0.0) -> tuple[Pole, ...]:
    """Return poles from slow to fast, without those of a sampled loop that end within a tick."""
    poles = (Pole.of(complex(value), dt) for value in values if not dt or abs(value) > GONE)
    return tuple(sorted(poles, key=lambda pole: (pole.hz, pole.value.imag)))


def _dead_time_margin(loop: SampledLoop, name: str) -> Limit:
    """Return the smallest addition [ms] to a dead time of a stable loop at which it oscillates.

    Parts of a tick also change when within the tick a duty acts or a sample is taken, so it is
    found by the poles: a phase margin divided by its frequency would miss it.
    """

    def slowest(extra_ms: float) -> complex:
        delayed = replace(loop.delays, **{name: getattr(loop.delays, name) + extra_ms})
        return complex(max(loop.with_delays(delayed).poles(), key=abs))

    def excess(extra_ms: float) -> float:
        return abs(slowest(extra_ms)) - 1.0

    stable = 0.0
    while stable < MAX_DEAD_TIME_MS:
        unstable = stable + max(MIN_STEP_MS, RELATIVE_STEP * stable)
        if excess(unstable) >= 0.0:
            margin = float(brentq(excess, stable, unstable, xtol=1e-6))
            # Just beyond it, no pole that hardly decays is as large as the one that oscillates.
            angle = abs(cmath.phase(slowest(margin + 2e-6)))
            return Limit(margin, angle / (2.0 * math.pi * loop.period_s))
        stable = unstable
    return Limit(math.inf, math.nan)


def _noise(loop: SampledLoop, source: str) -> float:
    """Return the standard deviation of the duty for white noise of 1 at an input."""
    system = loop.duty_for(source)
    covariance = steady_covariance(system.A, system.B @ system.B.T)
    variance = system.C @ covariance @ system.C.T + system.D**2
    return math.sqrt(variance.item())
