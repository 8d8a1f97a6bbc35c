"""Which of the varied values matter for which result: sensitivity indices of given samples.

The runs of a study are no design for an index, such as Saltelli's, so only methods for given
samples serve. Two of SALib's are used: RBD-FAST, the share of the variance that a variable explains
on its own, and PAWN, how far the distribution of the result moves with the variable, by whatever
part of it. The second sees variables that change the spread but not the mean, or that act only
together with others.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ballbot_ros.engine.rows import Column
from ballbot_ros.errors import importing
from ballbot_ros.robot.arithmetic import Floats

MAX_SAMPLE = 20_000
"""Largest number of runs that are used; the indices of more differ by less than their intervals."""

MIN_SAMPLE = 200
"""Smallest number of runs for which there are indices: ten in each harmonic of RBD-FAST."""

RESAMPLES = 50
HARMONICS = 10
SLICES = 10
"""Slices of a variable's values for PAWN."""

_BLUR, _LEAST_BLUR = 0.01, 4.0
"""Distance over which runs change places: part of their number, small against the shortest period
of RBD-FAST, and number of places."""

_EXACT = 10_000
"""Number of values up to which scipy's KS test computes exact probabilities, which are slow."""


@dataclass(frozen=True)
class Sensitivity:
    """Sensitivity indices of results (m) to variables (n).

    Attributes
    ----------
    variables, results : tuple of str
        Names.
    first_order, half_width : ndarray, shape (n, m)
        First-order index, and half of its 95 % interval; NaN for a result that does not vary or has
        too few values.
    pawn : ndarray, shape (n, m)
        PAWN index: median over :data:`SLICES` slices of the variable of the distance between the
        distributions of the result in the slice and in all runs (Kolmogorov and Smirnov).
    floor : ndarray, shape (m,)
        PAWN index of a variable without influence, by a column of random numbers.
    counts : ndarray of int, shape (m,)
        Number of runs with a value.
    sampled : int
        Number of runs that were looked at.
    """

    variables: tuple[str, ...]
    results: tuple[str, ...]
    first_order: Floats
    half_width: Floats
    pawn: Floats
    floor: Floats
    counts: NDArray[np.int64]
    sampled: int

    def most_influential(self, most: int) -> list[str]:
        """Return the names of the variables with the most influence, by their ranks.

        At least two are named; more only if their influence is twice that of random numbers.
        """
        influence = self.influence()
        order = np.argsort(-influence, kind='stable')[:most].tolist()
        limit = 2.0 * np.nan_to_num(self.floor[-1]) if self.floor.size else 0.0
        return [
            self.variables[place]
            for rank, place in enumerate(order)
            if rank < 2 or influence[place] > limit
        ]

    def influence(self) -> Floats:
        """Return a number for each variable, shape (n,), by which variables are ranked.

        It is the larger of the two indices of the last result, or of all if that one does not vary.
        """
        both = np.fmax(self.first_order, self.pawn)
        if both.size and not np.isnan(both[:, -1]).any():
            passing: Floats = both[:, -1]
            return passing
        largest: Floats = np.nan_to_num(both).max(axis=1, initial=0.0)
        return largest


def analyse(
    variables: Mapping[str, Column], results: Mapping[str, Floats], seed: int
) -> Sensitivity:
    """Return the indices of results to variables that were drawn independently of each other.

    It raises BallbotError if SALib is not installed.

    Parameters
    ----------
    variables : mapping of str to ndarray
        Each (r,): numbers, switches or words.
    results : mapping of str to ndarray
        Each (r,); NaN where there is no value. Such runs are left out for this result.
    seed : int
        Seed of resampling, and of the order of equal values.
    """
    with importing('study'):
        from SALib.analyze import pawn, rbd_fast
    random = np.random.default_rng(seed)
    count = len(next(iter(results.values()), ()))
    # Equal values in a grid come in the order of the other variables, so shuffle first.
    order = random.permutation(count)
    inputs = [_spread(values[order], random) for values in variables.values()]
    inputs.append(random.random(count))  # the one without influence
    shape = (len(inputs), len(results))
    first, half, distance = (np.full(shape, np.nan) for _ in range(3))
    counts = np.zeros(len(results), np.int64)
    for column, values in enumerate(results.values()):
        result = values[order].astype(float)
        kept = np.isfinite(result)
        result = result[kept]
        counts[column] = result.size
        if result.size < MIN_SAMPLE or np.ptp(result) == 0.0:
            continue
        copies = -(-(_EXACT + 1) // result.size)  # which change no distribution
        for row, each in enumerate(inputs):
            given = each[kept][:, None]
            problem = {'num_vars': 1, 'names': ['x'], 'bounds': [[0.0, 1.0]]}
            indices = rbd_fast.analyze(
                problem, given, result, M=HARMONICS, num_resamples=RESAMPLES, seed=seed % 2**32
            )
            first[row, column] = indices['S1'][0]
            # SALib resamples half of the runs, whose scatter is √2 times that of all.
            half[row, column] = indices['S1_conf'][0] / np.sqrt(2.0)
            distance[row, column] = pawn.analyze(
                problem, np.tile(given, (copies, 1)), np.tile(result, copies), S=SLICES
            )['median'][0]
    return Sensitivity(
        tuple(variables),
        tuple(results),
        first[:-1],
        half[:-1],
        distance[:-1],
        distance[-1],
        counts,
        count,
    )


def _spread(values: Column, random: np.random.Generator) -> Floats:
    """Return different numbers in the order of values, but for neighbours.

    Both methods depend on the order only. Equal values get a random order, so that the slices of
    PAWN hold equally many runs, also of words and of whole numbers.

    Neighbours change places at random, because RBD-FAST puts those with even and odd ranks into
    different halves of a period. In a Sobol sequence of one variable these ranks alternate with the
    halves of another one, whose effect would count for both.
    """
    count = len(values)
    places = np.lexsort([random.random(count), values])
    ranks = np.empty(count)
    ranks[places] = np.arange(count)
    return ranks + random.uniform(0.0, max(_LEAST_BLUR, _BLUR * count), count)
