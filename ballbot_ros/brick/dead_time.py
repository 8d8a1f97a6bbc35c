"""Dead time: how old the samples of a device are, and how late a duty takes effect.

It is in whole physics steps, and depends on parameters, the seed and the time alone, like the noise
of a device: a driver that restarts in mid-run continues with the same ages.
"""

from __future__ import annotations


def drawn_delay(delay: int, jitter: int, chance: float) -> int:
    """Return a dead time of `delay` to `delay + jitter` steps, all equally likely.

    `chance` is a uniform number within [0, 1).
    """
    return delay + int(chance * (jitter + 1))


def mean_delay(delay: int, jitter: int, period: int) -> float:
    """Return the mean dead time [steps] of samples or duties of a `period` [steps].

    With jitter it is less than the mean of the drawn ones: it is more than `a` only if that also
    holds for each sample or duty before, plus the time since then.
    """
    mean, highest = 0.0, delay + jitter
    for age in range(highest):
        chance = 1.0
        for excess in range(age % period, age + 1, period):
            if excess >= delay:
                chance *= (highest - excess) / (jitter + 1)
        mean += chance
    return mean
