"""Samples of a study: the values of its variables, run by run."""

from __future__ import annotations

import math
import warnings
import zlib
from collections.abc import Callable
from functools import partial

import numpy as np
from numpy.typing import NDArray

from ballbot_ros.engine.rows import Column
from ballbot_ros.lab.studies.runs import Samples
from ballbot_ros.lab.studies.study import Sampling, Study, grid_shape
from ballbot_ros.lab.studies.variables import SEED, Levels
from ballbot_ros.robot.arithmetic import Floats
from ballbot_ros.robot.random_numbers import Words, bits_53, noise_key, philox4x32

_WORD = 0xFFFFFFFF
_VALUES, _SEEDS = (np.uint64(zlib.crc32(use)) for use in (b'study values', b'study seeds'))
_PER_2_53 = 2.0**-53
_BELOW_ONE = 1.0 - _PER_2_53


class Sampler:
    """Draws the samples of a study, in parts.

    A run's sample depends on the study, its seed and the number of the run, not on the part. Only
    for a Latin hypercube it depends on the number of runs, too.
    """

    def __init__(self, study: Study) -> None:
        self._study = study
        self._shares = _shares(study)

    def part(self, first: int, last: int) -> Samples:
        """Return the samples of the runs from `first` up to, but not including, `last`.

        Parts in rising order are drawn fastest.
        """
        study = self._study
        if self._shares is None:
            columns = _grid_values(study, first, last)
        else:
            shares = self._shares(first, last)
            columns = {
                each.name: each.distribution.values(shares[:, number])
                for number, each in enumerate(study.variables)
            }
        if study.draws_seeds:
            columns[SEED] = seeds_of_runs(study.seed, first, last)
        return study.samples(columns, first)


def seeds_of_runs(seed: int, first: int, last: int) -> NDArray[np.int64]:
    """Return the seeds of the device noise of runs, given the study's seed.

    They have 53 bits, so that every program reads them exactly.
    """
    words = _words(seed, first, last, 0, _SEEDS)
    return np.asarray(bits_53(words.w0, words.w1), np.int64)


def _words(seed: int, first: int, last: int, variable: int, use: np.uint64) -> Words:
    runs = np.arange(first, last, dtype=np.uint64)
    low, high = runs & np.uint64(_WORD), runs >> np.uint64(32)
    return philox4x32(low, high, np.uint64(variable), use, *noise_key(seed))


Shares = Callable[[int, int], Floats]
"""Returns numbers within [0, 1) for the runs from one up to another, and each variable, (r, v)."""


def _shares(study: Study) -> Shares | None:
    """Return what draws the numbers for a study; None for a grid."""
    count = len(study.variables)
    if study.sampling is Sampling.GRID:
        return None
    if study.sampling is Sampling.RANDOM or not count:
        return partial(_random_shares, study.seed, count)
    if study.sampling is Sampling.LATIN_HYPERCUBE:
        from scipy.stats import qmc

        engine = qmc.LatinHypercube(count, seed=np.random.default_rng(study.seed))
        shares = _below_one(engine.random(study.runs))
        return lambda first, last: shares[first:last]
    return _Sequence(study.sampling, study.seed, count).part


def _random_shares(seed: int, count: int, first: int, last: int) -> Floats:
    """Return independent random numbers, a function of seed, run and variable."""
    shares = np.empty((last - first, count))
    for variable in range(count):
        words = _words(seed, first, last, variable, _VALUES)
        shares[:, variable] = bits_53(words.w0, words.w1) * _PER_2_53
    return shares


class _Sequence:
    """A scrambled low-discrepancy sequence."""

    def __init__(self, sampling: Sampling, seed: int, count: int) -> None:
        self._sampling, self._seed, self._count = sampling, seed, count
        self._restart()

    def _restart(self) -> None:
        from scipy.stats import qmc

        cls = qmc.Sobol if self._sampling is Sampling.SOBOL else qmc.Halton
        self._engine = cls(self._count, scramble=True, seed=np.random.default_rng(self._seed))
        self._next = 0

    def part(self, first: int, last: int) -> Floats:
        if first < self._next:
            self._restart()
        if first > self._next:
            self._engine.fast_forward(first - self._next)
        self._next = last
        with warnings.catch_warnings():
            # Any number of points has a low discrepancy, if not the lowest.
            warnings.filterwarnings('ignore', "The balance properties of Sobol' points")
            shares = self._engine.random(last - first)
        return _below_one(shares)


def _below_one(shares: Floats) -> Floats:
    """Return the numbers with each 1, which rounding may have made, replaced."""
    return np.asarray(np.minimum(shares, _BELOW_ONE))


def _grid_values(study: Study, first: int, last: int) -> dict[str, Column]:
    """Return all combinations of the levels; the last variable varies fastest, repeats slowest."""
    point = np.arange(first, last) % math.prod(grid_shape(study.variables))
    columns: dict[str, Column] = {}
    for each in reversed(study.variables):
        assert isinstance(each.distribution, Levels)
        point, level = np.divmod(point, len(each.distribution.levels))
        columns[each.name] = each.distribution.at(level)
    return {each.name: columns[each.name] for each in study.variables}
