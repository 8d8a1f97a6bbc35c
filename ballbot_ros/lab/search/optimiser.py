"""What chooses the next candidates of a search, within the unit cube."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ballbot_ros.errors import importing
from ballbot_ros.parameters.parameter import TextEnum
from ballbot_ros.robot.arithmetic import Floats

_BELOW_ONE = 1.0 - 2.0**-53
_CONVERGED = 1e-4
"""Size of the steps, as a share of the range, below which a search begins elsewhere."""


class Method(TextEnum):
    """How candidates are chosen."""

    CMA = 'cma'
    RANDOM = 'random'


class RandomSearch:
    """Independent random points, `population` in a generation; the first one is `start`, (d,)."""

    def __init__(self, start: Floats, population: int, seed: tuple[int, ...]) -> None:
        self._first: Floats | None = start
        self._random = np.random.default_rng(seed)
        self._shape = population, len(start)

    def ask(self) -> Floats:
        """Return the points of the next generation, within [0, 1), shape (n, d)."""
        points = self._random.random(self._shape)
        if self._first is not None:
            points[0], self._first = self._first, None
        return points

    def tell(self, costs: Floats) -> None:
        """Learn nothing."""


class CovarianceAdaptation:
    """CMA-ES by the package `cma`; where it has converged, it begins again at a random point.

    The first point is the start. The parameters are those of :class:`RandomSearch`. It raises
    MissingExtraError if `cma` is not installed.

    Parameters
    ----------
    steps : ndarray of float, shape (d,)
        Smallest standard deviation of each coordinate, so that no discrete one freezes.
    step : float
        Standard deviation at the start.
    """

    def __init__(
        self,
        start: Floats,
        population: int,
        seed: tuple[int, ...],
        steps: Floats,
        step: float,
    ) -> None:
        with importing('search'):
            import cma
        self._cma = cma
        # The package would use numpy's global numbers.
        self._random = np.random.RandomState(np.random.SeedSequence(seed).generate_state(8))
        self._population, self._step, self._count = population, step, len(start)
        if self._count == 1:  # the package needs at least two, so a second one has no effect
            start, steps = np.append(start, 0.5), np.append(steps, 0.0)
        self._steps = steps
        self._first: Floats | None = start
        self._points: list[NDArray[np.float64]] = []
        self._strategy = self._begin(start)

    def _begin(self, point: Floats) -> Any:
        options = {
            'bounds': [0.0, _BELOW_ONE],
            'popsize': self._population,
            'minstd': self._steps,
            'randn': self._random.randn,
            'seed': np.nan,  # it has its numbers
            'tolx': _CONVERGED,
            'verbose': -9,
        }
        return self._cma.CMAEvolutionStrategy(point, self._step, options)

    def ask(self) -> Floats:
        """Return the points of the next generation."""
        if self._strategy.stop():
            self._strategy = self._begin(self._random.random(len(self._steps)))
        self._points = self._strategy.ask()
        if self._first is not None:
            self._points[0], self._first = self._first, None
        return np.clip(np.array(self._points)[:, : self._count], 0.0, _BELOW_ONE)

    def tell(self, costs: Floats) -> None:
        """Take the costs of these points, shape (n,); the lower, the better."""
        self._strategy.tell(self._points, costs.tolist())


Optimiser = RandomSearch | CovarianceAdaptation
"""Chooses points of the unit cube; the same costs lead to the same points."""


def optimiser_of(
    method: Method,
    start: Floats,
    population: int,
    seed: tuple[int, ...],
    steps: Floats,
    step: float,
) -> Optimiser:
    """Return what chooses the points by a method; see the classes."""
    if method is Method.RANDOM:
        return RandomSearch(start, population, seed)
    return CovarianceAdaptation(start, population, seed, steps, step)
