"""Proportions, and how well a sample determines them."""

from __future__ import annotations

import math
from statistics import NormalDist
from typing import NamedTuple


class ProportionInterval(NamedTuple):
    """A confidence interval of a proportion."""

    low: float
    high: float


def wilson_interval(successes: int, count: int, confidence: float = 0.95) -> ProportionInterval:
    """Return Wilson's score interval of a proportion, without continuity correction.

    Unlike the interval that is symmetric about the share, it stays within 0 and 1, and has a width
    even if all or none succeed. Without any trial it is the whole range.

    Parameters
    ----------
    successes, count : int
        Number of successes, and of all trials.
    confidence : float
        Probability that the interval covers the true proportion.

    Raises
    ------
    ValueError
        If there are more successes than trials, or fewer than 0.

    References
    ----------
    E. B. Wilson: Probable inference, the law of succession, and statistical inference. Journal of
    the American Statistical Association 22 (1927), 209–212.
    """
    if not 0 <= successes <= count:
        raise ValueError(f'{successes} successes of {count}')
    if count == 0:
        return ProportionInterval(0.0, 1.0)
    z = NormalDist().inv_cdf((1 + confidence) / 2)
    squared = z * z
    middle = (successes + squared / 2) / (count + squared)
    variance = successes * (count - successes) / count + squared / 4
    half_width = z * math.sqrt(variance) / (count + squared)
    # Where all or none succeed, the ends are exact, whatever the rounding.
    low = 0.0 if successes == 0 else middle - half_width
    high = 1.0 if successes == count else middle + half_width
    return ProportionInterval(low, high)
