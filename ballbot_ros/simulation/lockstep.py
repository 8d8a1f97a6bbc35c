"""The controller's side of the lockstep.

A tick runs when every input due at its time is in and every task due has been released.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from enum import Enum, auto
from typing import Any

from ballbot_ros.brick.schedule import TaskTiming
from ballbot_ros.simulation.sample_history import Sample, SampleHistory
from ballbot_ros.simulation.task_releases import DueTick, TaskReleases


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
    """What the controller does with a sample that leads to no tick."""

    IGNORE = auto()
    KEEP = auto()
    ANSWER_AGAIN = auto()
    LACKS_RELEASES = auto()
    OBJECT = auto()
    MISSED_START = auto()
    BEGIN_AFRESH = auto()
    GIVE_UP = auto()


class LockstepTicks:
    """Decides in lockstep what each sample and each callback of a timer leads to.

    Samples count from the first one of the plant itself on: it comes when every participant has
    joined the run, so none of an earlier run can follow it. A second sample or callback of one
    time changes nothing; one that is missing holds the tick back. If the plant then asks again,
    missing inputs come again, and missing releases are forced.

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
    releases : TaskReleases
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
        self.releases = TaskReleases()
        self._first, self._every_tick, self._tick_ns = first, every_tick, tick_ns
        self._histories = {name: SampleHistory(is_same[name]) for name in periods_ns}
        self._start_ns: int | None = None
        self._next_ns: int | None = None
        self._is_open = False

    def begin(self, start_ns: int, tasks: Iterable[TaskTiming]) -> None:
        """Wait for the first tick of a run, at `start_ns` [ns]; nothing of another one counts."""
        self.gate.clear()
        for history in self._histories.values():
            history.clear()
        self.releases.begin(start_ns, tasks)
        self._start_ns, self._next_ns, self._is_open = start_ns, None, False

    def take(self, name: str, stamp_ns: int, data: bytes, value: Any) -> Step | DueTick:
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

        Returns
        -------
        Step or DueTick
            A tick if this sample was all that it waited for.
        """
        if self._start_ns is None or stamp_ns < self._start_ns:
            return Step.IGNORE
        self._is_open = self._is_open or name == self._first
        if not self._is_open:
            return Step.IGNORE
        if self._next_ns is None and stamp_ns > self._start_ns and name != self._first:
            return Step.MISSED_START if name == self._every_tick else Step.IGNORE
        if self._next_ns is not None and stamp_ns > self._next_ns:
            return Step.OBJECT
        sample = self._histories[name].judge(stamp_ns, data)
        if sample is Sample.CONTRADICTING:
            return Step.OBJECT
        if sample is Sample.REPEATED:
            return self._answer_repeated(stamp_ns)
        if sample is Sample.OLD:
            return Step.IGNORE
        self.gate.put(name, stamp_ns, value)
        if self._next_ns is None and name == self._every_tick:
            self._next_ns = stamp_ns
        return self._due_tick() or Step.KEEP

    def _answer_repeated(self, stamp_ns: int) -> Step:
        """Decide what a sample leads to that comes again: the plant has not got the answer."""
        if self._next_ns == stamp_ns + self._tick_ns:
            return Step.ANSWER_AGAIN
        if self._next_ns == stamp_ns and self.gate.ready(stamp_ns):
            return Step.LACKS_RELEASES
        return Step.IGNORE

    def force(self, *, callback_waits: bool) -> DueTick | None:
        """Make good what the timers have left out of a tick that lacks nothing else.

        Parameters
        ----------
        callback_waits : bool
            Whether a timer is about to call back: then nothing is forced yet.
        """
        if self._next_ns is None or callback_waits:
            return None
        self.releases.force(self._next_ns)
        return self._due_tick()

    def on_timer(self, task: str, now_ns: int) -> DueTick | None:
        """Release a task whose timer calls back; return the tick that waited only for that.

        Parameters
        ----------
        task : str
        now_ns : int
            Sim time of the callback [ns].
        """
        self.releases.release(task, now_ns)
        return self._due_tick()

    def start_late(self, stamp_ns: int, *, now_ns: int, rejoin: bool) -> Step:
        """Decide what follows from a missed start.

        Parameters
        ----------
        stamp_ns : int
            Stamp of the sample that showed it [ns].
        now_ns : int
            Sim time [ns]. The tick of now is the one for which the plant asks; an earlier one has
            been answered by another controller.
        rejoin : bool
            Whether the controller may begin afresh in mid-run.
        """
        if stamp_ns != now_ns:
            return Step.IGNORE
        if not rejoin:
            return Step.GIVE_UP
        self._next_ns = stamp_ns
        return Step.BEGIN_AFRESH

    def _due_tick(self) -> DueTick | None:
        """Return the next tick and go on to the one after it, if nothing is missing."""
        now = self._next_ns
        if now is None or not self.gate.ready(now) or self.releases.missing(now):
            return None
        self._next_ns = now + self._tick_ns
        return self.releases.take(now)
