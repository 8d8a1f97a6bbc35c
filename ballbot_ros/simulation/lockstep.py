"""The controller's side of the lockstep: a tick runs when every input due at its time is in."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import Enum, auto
from typing import Any

from ballbot_ros.simulation.sample_history import Sample, SampleHistory


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


@dataclass(frozen=True)
class Run:
    """A run as its plant announces it.

    Attributes
    ----------
    name : str
        Number of the run, and a token that tells its plant from all others.
    start_ns : int
        Stamp of its first tick [ns].
    """

    name: str
    start_ns: int

    @property
    def number(self) -> str:
        """Its number, from 1 on."""
        return self.name.partition(' ')[0]

    @property
    def plant(self) -> str:
        """The token of its plant."""
        return self.name.partition(' ')[2]


class Step(Enum):
    """What the controller does with a sample."""

    IGNORE = auto()
    KEEP = auto()
    TICK = auto()
    ANSWER_AGAIN = auto()
    OBJECT = auto()
    MISSED_START = auto()


class LockstepInputs:
    """The controller's inputs in lockstep: decides what a sample leads to.

    Samples count from the first one of the plant itself on: it comes when every participant has
    joined the run, so none of an earlier run can follow it.

    Parameters
    ----------
    periods_ns : mapping of str to int
        The inputs and the period of each [ns].
    first : str
        The input that the plant itself publishes.
    every_tick : str
        The input whose first sample is the controller's first tick.
    is_same : mapping of str to callable
        For each input, whether two serialised messages say the same.
    tick_ns : int
        Period of the ticks [ns].

    Attributes
    ----------
    gate : InputGate
    next_ns : int or None
        Stamp of the next tick [ns]; None before the first.
    """

    def __init__(
        self,
        periods_ns: Mapping[str, int],
        *,
        first: str,
        every_tick: str,
        is_same: Mapping[str, Callable[[bytes, bytes], bool]],
        tick_ns: int,
    ) -> None:
        self.gate = InputGate(periods_ns)
        self.next_ns: int | None = None
        self._first, self._every_tick, self._tick_ns = first, every_tick, tick_ns
        self._histories = {name: SampleHistory(is_same[name]) for name in periods_ns}
        self._start_ns: int | None = None
        self._is_open = False

    def begin(self, start_ns: int) -> None:
        """Wait for the first tick of a run, at `start_ns` [ns]; nothing of another one counts."""
        self.gate.clear()
        for history in self._histories.values():
            history.clear()
        self._start_ns, self.next_ns, self._is_open = start_ns, None, False

    def take(self, name: str, stamp_ns: int, data: bytes, value: Any) -> Step:
        """Decide what a sample leads to.

        Parameters
        ----------
        name : str
            The input.
        stamp_ns : int
            Stamp of the sample [ns].
        data : bytes
            The sample as it came.
        value : object
            What the brick reads from it.
        """
        if self._start_ns is None or stamp_ns < self._start_ns:
            return Step.IGNORE
        self._is_open = self._is_open or name == self._first
        if not self._is_open:
            return Step.IGNORE
        if self.next_ns is None and stamp_ns > self._start_ns and name != self._first:
            return Step.MISSED_START if name == self._every_tick else Step.IGNORE
        if self.next_ns is not None and stamp_ns > self.next_ns:
            return Step.OBJECT
        sample = self._histories[name].judge(stamp_ns, data)
        if sample is Sample.CONTRADICTING:
            return Step.OBJECT
        if sample is Sample.REPEATED and self.next_ns == stamp_ns + self._tick_ns:
            # The plant asks again: it has not got the answer.
            return Step.ANSWER_AGAIN
        if sample is not Sample.NEW:
            return Step.IGNORE
        self.gate.put(name, stamp_ns, value)
        if self.next_ns is None and name == self._every_tick:
            self.next_ns = stamp_ns
        is_ready = self.next_ns is not None and self.gate.ready(self.next_ns)
        return Step.TICK if is_ready else Step.KEEP

    def begin_afresh(self, stamp_ns: int) -> None:
        """Begin in mid-run, at a tick for which the plant asks [ns]."""
        self.next_ns = stamp_ns

    def ticked(self) -> None:
        """Go on to the next tick."""
        if self.next_ns is not None:
            self.next_ns += self._tick_ns


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
