"""The gate of the lockstep: a tick runs when every input due at its time is in."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any


class InputGate:
    """Holds the newest sample of each input until all that are due at one time are there.

    A sample is known by its stamp, so one that comes twice changes nothing.

    Parameters
    ----------
    periods_ns : mapping of str to int
        The inputs and the period of each [ns]; an input is due at multiples of its period.
    """

    def __init__(self, periods_ns: Mapping[str, int]) -> None:
        self._periods = dict(periods_ns)
        self._samples: dict[str, tuple[int, Any]] = {}

    def put(self, name: str, stamp_ns: int, value: Any) -> bool:
        """Keep a sample; return whether it is newer than the one that was there."""
        known = self._samples.get(name)
        if known is not None and stamp_ns <= known[0]:
            return False
        self._samples[name] = (stamp_ns, value)
        return True

    def stamp(self, name: str) -> int | None:
        """Return the stamp [ns] of the newest sample of an input, None before the first."""
        known = self._samples.get(name)
        return None if known is None else known[0]

    def newest(self, name: str) -> Any:
        """Return the newest sample of an input, None before the first."""
        known = self._samples.get(name)
        return None if known is None else known[1]

    def clear(self) -> None:
        """Forget every sample: a new run has begun."""
        self._samples.clear()

    def missing(self, stamp_ns: int) -> list[str]:
        """Return the inputs due at `stamp_ns` whose sample of that stamp is not there."""
        return [
            name
            for name, period in self._periods.items()
            if stamp_ns % period == 0 and self.stamp(name) != stamp_ns
        ]

    def ready(self, stamp_ns: int) -> bool:
        """Tell whether every input due at `stamp_ns` is there."""
        return not self.missing(stamp_ns)


class RunFollower:
    """Tells to which run a stamp belongs, from the latched announcements of the plant.

    Announcements and samples come on different topics, so a sample can overtake the announcement
    of its run; until that has come the sample belongs to no known run.

    Attributes
    ----------
    start_ns : int or None
        First tick of the newest announced run.
    """

    def __init__(self) -> None:
        self.start_ns: int | None = None
        self._name: str | None = None
        self._last_ns: int | None = None

    def announced(self, start_ns: int, name: str) -> bool:
        """Take an announcement; return whether the run is a new one."""
        if name == self._name:
            return False
        self._name, self.start_ns, self._last_ns = name, start_ns, None
        return True

    def elapsed_ns(self, stamp_ns: int, period_ns: int) -> int | None:
        """Return the time since the start of the run, or None if the run is not known yet.

        Parameters
        ----------
        stamp_ns : int
            Stamp of a sample.
        period_ns : int
            Period of such samples: a longer leap means that another run has begun.
        """
        if self.start_ns is None or stamp_ns < self.start_ns:
            return None
        leapt = self._last_ns is not None and stamp_ns > self._last_ns + period_ns
        if leapt and stamp_ns != self.start_ns:
            return None
        self._last_ns = stamp_ns
        return stamp_ns - self.start_ns


class TimerAudit:
    """Compares the callbacks of a timer with the schedule that the run follows.

    Parameters
    ----------
    period_ns : int
        Period of the timer [ns].

    Attributes
    ----------
    fired, disagreements : int
        Callbacks so far; callbacks at a wrong time, twice at one time, or left out.
    """

    def __init__(self, period_ns: int) -> None:
        self._period = period_ns
        self._last_ns: int | None = None
        self.fired = 0
        self.disagreements = 0

    def restart(self) -> None:
        """Begin a new run: the leap in time is not a disagreement."""
        self._last_ns = None

    def fire(self, now_ns: int, start_ns: int) -> None:
        """Note a callback at sim time `now_ns` in a run that began at `start_ns`."""
        self.fired += 1
        if now_ns < start_ns:
            return
        if (now_ns - start_ns) % self._period or now_ns == self._last_ns:
            self.disagreements += 1
            return
        if self._last_ns is not None and now_ns > self._last_ns:
            self.disagreements += (now_ns - self._last_ns) // self._period - 1
        self._last_ns = now_ns
