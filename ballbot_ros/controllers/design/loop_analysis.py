"""What the loop of one plane can bear: poles, margins and noise, ideal and as it runs."""

from __future__ import annotations

import cmath
import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple

import numpy as np
from scipy.optimize import bisect

from ballbot_ros.controllers.design.linear_model import ideal_loop
from ballbot_ros.controllers.design.margins import Limit, LoopResponse, Margins, steady_covariance
from ballbot_ros.controllers.design.sampled_loop import (
    ENCODER_ERROR,
    GYRO_ERROR,
    LoopDelays,
    SampledLoop,
)
from ballbot_ros.parameters import ParameterSet
from ballbot_ros.parameters.timing import TICK_S

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
    """Properties of a closed loop.

    Attributes
    ----------
    poles : tuple of Pole
        From slow to fast.
    margins : Margins or None
        None if the loop is unstable.
    samples : SampleAnalysis or None
        None in continuous time, or if the loop is unstable.
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


def analyse_sampled(parameters: ParameterSet) -> LoopAnalysis:
    """Analyse the loop as it runs, as a :class:`SampledLoop`.

    Raises
    ------
    DesignError
        If the controller is not the document's program.
    """
    delays = LoopDelays.of(parameters)
    loop = SampledLoop(parameters, delays)
    poles = sorted_poles(loop.poles(), TICK_S)
    if not all(pole.is_stable for pole in poles):
        return LoopAnalysis(poles, None)
    dead_time = partial(_dead_time_margin, parameters, delays)
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


def sorted_poles(values: Iterable[complex], dt: float = 0.0) -> tuple[Pole, ...]:
    """Return poles from slow to fast, without those of a sampled loop that end within a tick."""
    poles = (Pole.of(complex(value), dt) for value in values if not dt or abs(value) > GONE)
    return tuple(sorted(poles, key=lambda pole: (pole.hz, pole.value.imag)))


def _dead_time_margin(parameters: ParameterSet, delays: LoopDelays, name: str) -> Limit:
    """Return the smallest additional dead time [ms] at which the loop oscillates.

    Parts of a tick also change when within the tick a duty acts or a sample is taken, so it is
    found by the poles: a phase margin divided by its frequency would miss it.

    Parameters
    ----------
    name : str
        Which of `delays` grows.
    """

    def slowest(extra_ms: float) -> complex:
        delayed = replace(delays, **{name: getattr(delays, name) + extra_ms})
        return complex(max(SampledLoop(parameters, delayed).poles(), key=abs))

    def excess(extra_ms: float) -> float:
        return abs(slowest(extra_ms)) - 1.0

    stable = 0.0
    while stable < MAX_DEAD_TIME_MS:
        unstable = stable + max(MIN_STEP_MS, RELATIVE_STEP * stable)
        if excess(unstable) >= 0.0:
            margin = float(bisect(excess, stable, unstable, xtol=1e-6))
            return Limit(margin, abs(cmath.phase(slowest(margin))) / TICK_S / (2.0 * math.pi))
        stable = unstable
    return Limit(math.inf, math.nan)


def _noise(loop: SampledLoop, source: str) -> float:
    """Return the standard deviation of the duty for white noise of 1 at an input."""
    system = loop.duty_for(source)
    covariance = steady_covariance(system.A, system.B @ system.B.T)
    variance = system.C @ covariance @ system.C.T + system.D**2
    return math.sqrt(variance.item())
