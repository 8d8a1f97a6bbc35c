"""Dead time: how old the samples of a device are, and how late a duty takes effect.

It is in whole physics steps, and depends on parameters, the seed and the time alone, like the noise
of a device: a driver that restarts in mid-run continues with the same ages.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import lru_cache

from ballbot_ros.brick.noise import DeviceNoise
from ballbot_ros.numerics.random_numbers import uniform
from ballbot_ros.timing import STEP_NS


def drawn_delay(delay: int, jitter: int, chance: float) -> int:
    """Return a dead time of `delay` to `delay + jitter` steps, all equally likely.

    `chance` is a uniform number within [0, 1).
    """
    return delay + int(chance * (jitter + 1))


def sample_age(delays: Sequence[int], period: int) -> int:
    """Return the age [steps] of a sample: that of the newest measurement which has arrived by then.

    So a sample never measures an earlier instant than the sample before it.

    Parameters
    ----------
    delays : sequence of int
        Dead times [steps] of the sample and of those before it, the newest first.
    period : int
        Sampling period [steps].
    """
    age = delays[0]
    for number in range(1, len(delays)):
        age = min(age, delays[number] + number * period)
    return age


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


def newest_effective(effects_ns: Iterable[int], now_ns: int) -> int:
    """Return the position of the newest duty that has taken effect; -1 if none has.

    The effects of the duties [ns] begin with that of the newest one.
    """
    for number, effect_ns in enumerate(effects_ns):
        if effect_ns <= now_ns:
            return number
    return -1


class DeadTime:
    """The dead times of a device's samples or of the motors' duties.

    Parameters
    ----------
    device : str
        Name of the device, which together with the seed selects the random numbers.
    period_ns : int
        Period of the samples or duties [ns].
    delay, jitter : int
        The shortest dead time and the largest random addition to it [steps].
    seed : int
        Seed of the run.

    Attributes
    ----------
    longest : int
        The longest possible dead time [steps].
    """

    def __init__(self, device: str, period_ns: int, delay: int, jitter: int, seed: int) -> None:
        self._period_ns = period_ns
        self._period = period_ns // STEP_NS
        self._delay, self._jitter = delay, jitter
        self._noise = DeviceNoise(seed, f'{device} delay', uniform)
        # One that is earlier by more than the jitter has in any case measured an earlier instant.
        self._earlier = range(jitter // self._period + 1)
        # The age of a sample needs the delays of those before it again, across blocks of noise. As
        # the newest is used first, one place less would lose each before it is needed again.
        self._delay_of = lru_cache(len(self._earlier) + 1)(self._drawn_delay)
        self.longest = delay + jitter

    def delay(self, time_ns: int) -> int:
        """Return the dead time [steps] of the sample or duty of a sim time [ns]."""
        return self._delay_of(time_ns // self._period_ns)

    def age(self, stamp_ns: int) -> int:
        """Return the age [steps] of the sample with this stamp [ns]."""
        index = stamp_ns // self._period_ns
        return sample_age([self._delay_of(index - each) for each in self._earlier], self._period)

    def _drawn_delay(self, index: int) -> int:
        if not self._jitter:
            return self._delay
        return drawn_delay(self._delay, self._jitter, self._noise.pair(index)[0])
