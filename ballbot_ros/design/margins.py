"""Stability margins of a loop, in continuous time or sampled."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import control
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq, minimize_scalar

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

    Attributes
    ----------
    frequencies : ndarray, shape (n,)
        [rad/s].
    values : ndarray of complex, shape (n,)
        L at these frequencies.
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
