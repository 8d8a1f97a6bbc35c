"""The controller's side of the lockstep.

A tick runs when every input due at its time has arrived and every due task has been released.
"""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from enum import Enum, auto
from types import MappingProxyType
from typing import Any, Generic, NamedTuple, TypeVar

from ballbot_ros.parameters.timing import MAX_LEAD_TICKS, MILLISECOND_NS
from ballbot_ros.robot.brick.schedule import Schedule, TaskTiming

Answer = TypeVar('Answer')
"""What a node publishes for a tick."""


class DueTick(NamedTuple):
    """A tick that is due, and its tasks, highest priority first.

    The timers of the `untimed` ones have not released them, and must be restarted.
    """

    time_ns: int
    tasks: tuple[str, ...]
    untimed: tuple[str, ...]


class TaskReleases:
    """The releases of the tasks by their timers and by the start of a run.

    A timer releases its task for the time at which it fires. The start of a run releases all tasks
    due at the first tick, because no timer fires there after a jump of the clock. A release off the
    schedule, or a second one for the same time, changes nothing. `forced` counts the releases made
    without a timer.
    """

    def __init__(self) -> None:
        self.fired: Counter[str] = Counter()
        self.forced = 0
        self._schedule = Schedule(())
        self._periods_ns: dict[str, int] = {}
        self._released_ns: dict[str, int] = {}
        self._start_ns = 0
        self._forced_ns: int | None = None

    def begin(self, start_ns: int, tasks: Iterable[TaskTiming]) -> None:
        """Begin a run of `tasks` whose first tick is at `start_ns` [ns]."""
        self._schedule = Schedule(tasks)
        self._periods_ns = {
            task.name: task.period_ms * MILLISECOND_NS
            for task in self._schedule.tasks
            if task.period_ms
        }
        self._released_ns.clear()
        self._start_ns, self._forced_ns = start_ns, None

    def release(self, task: str, now_ns: int) -> None:
        """Release a task whose timer fired at sim time `now_ns` [ns]."""
        self.fired[task] += 1
        period_ns = self._periods_ns.get(task)
        if period_ns is None or now_ns < self._released_ns.get(task, self._start_ns):
            return
        if (now_ns - self._start_ns) % period_ns == 0:
            self._released_ns[task] = now_ns

    def missing(self, tick_ns: int) -> tuple[str, ...]:
        """Return the tasks due at `tick_ns` [ns] that have not been released for it."""
        if tick_ns in (self._start_ns, self._forced_ns):
            return ()
        return self._untimed(self._due(tick_ns), tick_ns)

    def force(self, tick_ns: int) -> None:
        """Release, and count, the tasks missing at `tick_ns` [ns]."""
        self.forced += len(self.missing(tick_ns))
        self._forced_ns = tick_ns

    def take(self, tick_ns: int) -> DueTick:
        """Return the tick at `tick_ns` [ns], for which no release may be missing."""
        due = self._due(tick_ns)
        return DueTick(tick_ns, due, self._untimed(due, tick_ns))

    def _due(self, tick_ns: int) -> tuple[str, ...]:
        return tuple(self._schedule.due((tick_ns - self._start_ns) // MILLISECOND_NS))

    def _untimed(self, due: Iterable[str], tick_ns: int) -> tuple[str, ...]:
        return tuple(
            name
            for name in due
            if name in self._periods_ns and self._released_ns.get(name) != tick_ns
        )


DEPTH = 16


class SampleStatus(Enum):
    """Relation of a sample to earlier ones on its topic."""

    NEW = auto()
    DUPLICATE = auto()
    CONFLICTING = auto()
    OLD = auto()


class SampleHistory:
    """The latest samples of a topic that has one sample per stamp.

    `is_same` compares the content of two serialised messages with one stamp.
    """

    def __init__(self, is_same: Callable[[bytes, bytes], bool]) -> None:
        self._is_same = is_same
        self._samples: deque[tuple[int, bytes]] = deque(maxlen=DEPTH)

    def clear(self) -> None:
        """Forget the samples: another run begins."""
        self._samples.clear()

    def classify(self, stamp_ns: int, data: bytes) -> SampleStatus:
        """Classify a sample, and store it if it is new.

        It is NEW if its stamp is newer than all others. If a sample with its stamp is stored, it is
        a DUPLICATE if the content is the same, or else CONFLICTING. Otherwise it is OLD.
        """
        samples = self._samples
        if not samples or stamp_ns > samples[-1][0]:
            samples.append((stamp_ns, data))
            return SampleStatus.NEW
        for known_ns, known in reversed(samples):
            if known_ns == stamp_ns:
                return (
                    SampleStatus.DUPLICATE
                    if self._is_same(known, data)
                    else SampleStatus.CONFLICTING
                )
        return SampleStatus.OLD


class GivenAnswers(Generic[Answer]):
    """Repeats the answer of a tick that the plant asks for again.

    It may ask for any tick that the recorder lacks, and meanwhile live inputs or what a fault holds
    have changed.
    """

    def __init__(self) -> None:
        self._answers: dict[int, Answer] = {}

    def at(self, stamp_ns: int, select: Callable[[], Answer]) -> Answer:
        """Return the answer given at a stamp [ns]; select it if there is none."""
        answer = self._answers.get(stamp_ns)
        if answer is None:
            answer = self._answers[stamp_ns] = select()
            if len(self._answers) > MAX_LEAD_TICKS + 1:
                del self._answers[next(iter(self._answers))]
        return answer


class InputGate:
    """Holds the newest sample of each input, and shows whether all that are due have arrived.

    An input is due at multiples of its period. Samples are identified by their stamps, so a
    repeated sample changes nothing.
    """

    def __init__(self, periods_ns: Mapping[str, int]) -> None:
        self._periods = dict(periods_ns)
        self._samples: dict[str, tuple[int, Any]] = {}

    def put(self, name: str, stamp_ns: int, value: object) -> bool:
        """Store a sample; return whether it is newer than the stored one."""
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

    def ready(self, stamp_ns: int) -> bool:
        """Return whether every input due at `stamp_ns` has arrived."""
        return not self.missing(stamp_ns)

    def missing(self, stamp_ns: int) -> list[str]:
        """Return the inputs due at `stamp_ns` that have not arrived."""
        return [
            name
            for name, period in self._periods.items()
            if stamp_ns % period == 0 and self.stamp(name) != stamp_ns
        ]


@dataclass(frozen=True)
class RunIdentity:
    """A run as announced: its number and the token of its plant, and its first tick [ns]."""

    name: str
    start_ns: int

    @property
    def number(self) -> str:
        """Number of the run, starting at 1."""
        return self.name.partition(' ')[0]

    @property
    def plant(self) -> str:
        """Token that identifies the plant."""
        return self.name.partition(' ')[2]


class SampleReaction(Enum):
    """The controller's reaction to a sample that starts no tick."""

    IGNORE = auto()
    STORE = auto()
    RESEND = auto()
    FORCE_RELEASES = auto()
    OBJECT = auto()
    MISSED_START = auto()
    RESTART = auto()
    ABORT = auto()


class LockstepTicks:
    """Decides, in lockstep, the reaction to each sample and each timer callback.

    Samples are ignored until the first one from the plant itself. The plant sends it when every
    participant has joined the run, so no sample of an earlier run can follow. A repeated sample or
    callback changes nothing; a missing one holds up the tick. When the plant asks again, the
    drivers resend missing inputs, and missing releases are forced.

    Parameters
    ----------
    first : str
        The input published by the plant itself.
    every_tick : str
        The input whose first sample defines the controller's first tick.
    is_same : mapping of str to callable
        For each input, a function that compares the content of two serialised messages.
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
        self._tasks_from: dict[int, Sequence[TaskTiming]] = {}
        self._start_ns: int | None = None
        self._next_ns: int | None = None
        self._answered_ns: int | None = None
        self._is_open = False
        self._received_ns: dict[str, int] = {}
        self._later: dict[str, tuple[int, bytes, Any]] = {}

    def begin(
        self,
        start_ns: int,
        tasks: Sequence[TaskTiming],
        changes: Mapping[int, bool] = MappingProxyType({}),
    ) -> None:
        """Wait for the first tick of a run, at `start_ns` [ns]; ignore all other runs.

        At each tick of `changes` [ns], the tasks begin anew, like at the start, or end.
        """
        self._tasks_from = {tick: tasks if is_on else () for tick, is_on in changes.items()}
        self.gate.clear()
        for history in self._histories.values():
            history.clear()
        self.releases.begin(start_ns, self._tasks_from.get(start_ns, tasks))
        self._start_ns, self._next_ns, self._is_open = start_ns, None, False
        self._answered_ns = None
        self._received_ns.clear()
        self._later.clear()

    def take(
        self, name: str, stamp_ns: int, data: bytes, value: object
    ) -> SampleReaction | DueTick:
        """Decide the reaction to a sample: a tick if it completes the inputs of one.

        `value` is what the brick reads from it.
        """
        self._received_ns[name] = stamp_ns
        if self._start_ns is None or stamp_ns < self._start_ns:
            return SampleReaction.IGNORE
        self._is_open = self._is_open or name == self._first
        if not self._is_open:
            return SampleReaction.IGNORE
        if stamp_ns > (self._start_ns if self._next_ns is None else self._next_ns):
            if self._answered_ns is not None:
                return SampleReaction.OBJECT
            # Another controller has answered the ticks before, or a stranger has sent the sample.
            self._later[name] = stamp_ns, data, value
            return SampleReaction.MISSED_START if name == self._every_tick else SampleReaction.STORE
        sample = self._histories[name].classify(stamp_ns, data)
        if sample is SampleStatus.CONFLICTING:
            return SampleReaction.OBJECT
        if sample is SampleStatus.DUPLICATE:
            return self._answer_repeated(stamp_ns)
        if sample is SampleStatus.OLD:
            return SampleReaction.IGNORE
        self.gate.put(name, stamp_ns, value)
        if self._next_ns is None and name == self._every_tick:
            self._next_ns = stamp_ns
        return self._due_tick() or SampleReaction.STORE

    def _answer_repeated(self, stamp_ns: int) -> SampleReaction:
        """Decide the reaction to a repeated sample: the plant still waits for the answer."""
        # If this controller has rejoined the run, another one has answered the tick before.
        if stamp_ns == self._answered_ns:
            return SampleReaction.RESEND
        if self._next_ns == stamp_ns and self.gate.ready(stamp_ns):
            return SampleReaction.FORCE_RELEASES
        return SampleReaction.IGNORE

    def force(self) -> DueTick | None:
        """Force the releases that a tick is still missing after all its inputs have arrived."""
        if self._next_ns is None:
            return None
        self.releases.force(self._next_ns)
        return self._due_tick()

    def on_timer(self, task: str, now_ns: int) -> DueTick | None:
        """Release a task whose timer fired; return the tick if it waited only for this release."""
        self.releases.release(task, now_ns)
        return self._due_tick()

    def on_missed_start(self, stamp_ns: int, *, now_ns: int, rejoin: bool) -> SampleReaction:
        """Decide the reaction to a missed start of the run, which a sample has revealed.

        The plant waits for the tick at `now_ns` [ns], the sim time; another controller has answered
        the earlier ones.
        """
        if stamp_ns != now_ns:
            return SampleReaction.IGNORE
        if not rejoin:
            return SampleReaction.ABORT
        self._next_ns = stamp_ns
        for name, (later_ns, data, value) in self._later.items():
            if later_ns <= stamp_ns:
                self._histories[name].classify(later_ns, data)
                self.gate.put(name, later_ns, value)
        self._later.clear()
        return SampleReaction.RESTART

    def awaited(self) -> dict[str, int | None]:
        """Return the inputs that the next tick lacks.

        For each, the stamp of the newest sample that has arrived since the last tick [ns], None if
        none has.
        """
        now = self._start_ns if self._next_ns is None else self._next_ns
        if now is None or not self._is_open:
            return {}
        if self._next_ns is None and max(self._received_ns.values(), default=now) > now:
            # It has missed the start, and this input tells it the present tick.
            return {self._every_tick: self._received_ns.get(self._every_tick)}
        return {name: self._received_ns.get(name) for name in self.gate.missing(now)}

    def _due_tick(self) -> DueTick | None:
        """Return the next tick and advance to the following one, if nothing is missing."""
        now = self._next_ns
        if now is None or not self.gate.ready(now) or self.releases.missing(now):
            return None
        self._answered_ns, self._next_ns = now, now + self._tick_ns
        self._received_ns.clear()
        tick = self.releases.take(now)
        if self._next_ns in self._tasks_from:
            self.releases.begin(self._next_ns, self._tasks_from[self._next_ns])
        return tick
