"""Finds the silent participants of a run, on a machine that may be too busy to let them answer."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass
from typing import NamedTuple, Protocol

from ballbot_ros.lockstep.participants import LocalNode, Participant
from ballbot_ros.lockstep.roster import Roster
from ballbot_ros.parameters import CONTROLLER, DRIVER_PERIODS_NS, DRIVERS, RECORDER

MAX_POLL_GAP_S = 0.2
"""Upper limit of the time counted between two updates: if this process was too busy to update the
measurement, it could not receive answers, either."""

MAX_USED_S = 1.0
"""The same for the processor time that an observed process has used meanwhile: one that computes
without an end does not last longer because nobody had the time to look."""


@dataclass(frozen=True)
class ThreadTime:
    """The processor time of a thread so far [s], and its time of waiting for a processor [s]."""

    cpu_s: float
    queued_s: float
    is_runnable: bool

    def starved_s(self, before: ThreadTime, span_s: float) -> float:
        """Return how much of the last `span_s` the thread spent waiting for a processor [s]."""
        if self.is_runnable and (self.cpu_s, self.queued_s) == (before.cpu_s, before.queued_s):
            return span_s  # It waited all along: the system counts a wait only when it ends.
        return self.queued_s - before.queued_s


Threads = Mapping[int, ThreadTime]
"""The threads of a process, by id."""


class Observation(NamedTuple):
    """The processor time of the living processes on this machine, by their ids, at a time [s]."""

    now_s: float
    threads: Mapping[int, Threads]


def available_s(threads: Threads, before: Threads, span_s: float) -> float:
    """Return the part of the last `span_s` in which a process did not wait for a processor [s].

    In a longer span than :data:`MAX_POLL_GAP_S`, other time than that of a processor is limited.
    """
    known = threads.keys() & before.keys()
    starved = (threads[each].starved_s(before[each], span_s) for each in known)
    used_s = max((threads[each].cpu_s - before[each].cpu_s for each in known), default=0.0)
    had_s = min(span_s - max(starved, default=0.0), used_s + MAX_POLL_GAP_S)
    return min(max(had_s, used_s), span_s)


class SilenceTimer:
    """Measures a silence separately for each process that could end it.

    Time in which a process waits for a processor does not count. Time in which it is stopped, gone,
    busy, or waiting for a message or a disk does.
    """

    def __init__(self) -> None:
        self._since_s = self._polled_at_s = self._elapsed_s = 0.0
        self._known: dict[int, Threads] = {}
        self._silences_s: dict[int, float] = {}

    def update(self, since_s: float, now_s: float, processes: Mapping[int, Threads]) -> None:
        """Update the measurement of a silence.

        It began at `since_s`, on the same clock as `now_s` [s]; a new value means another silence.
        `processes` are the local ones that could end the silence.
        """
        if since_s != self._since_s:
            self._since_s = self._polled_at_s = since_s
            self._elapsed_s = 0.0
            self._known.clear()
            self._silences_s.clear()
        gap_s = now_s - self._polled_at_s
        span_s = min(gap_s, MAX_POLL_GAP_S)
        self._polled_at_s = now_s
        self._elapsed_s += span_s
        for process in self._silences_s.keys() | processes.keys():
            threads, before = processes.get(process), self._known.get(process)
            had_s = span_s
            if threads and before:
                had_s = available_s(threads, before, min(gap_s, MAX_USED_S))
            self._silences_s[process] = self._silences_s.get(process, 0.0) + had_s
        self._known = dict(processes)

    def silence_s(self, process: int | None = None) -> float:
        """Return how much of the silence counts for a process [s], or for a remote one if None."""
        if process is None:
            return self._elapsed_s
        return self._silences_s.get(process, self._elapsed_s)


class ProcessObserver(Protocol):
    """Observes the processes of this machine."""

    def observe(self, processes: Iterable[int]) -> Observation:
        """Return the processor time that some processes have received so far."""

    def started_nodes(self) -> Collection[LocalNode]:
        """Return the living nodes that were started together with the plant, if known."""


class LivenessMonitor:
    """Measures how long each participant has left the plant without an answer."""

    def __init__(self, roster: Roster, process_observer: ProcessObserver, host: str) -> None:
        self._roster, self._process_observer, self._host = roster, process_observer, host
        self._timer = SilenceTimer()
        self._since_call: int | None = None
        self._called_s = 0.0

    def reset(self) -> None:
        """End the current silence: the awaited message has arrived, or another run begins."""
        self._since_call = None

    def call(self) -> None:
        """Note that a roll call is about to be made because of a silence."""
        if self._since_call is None:
            seen = self._process_observer.observe(self._participants())
            self._since_call, self._called_s = self._roster.calls, seen.now_s
            self._timer.update(seen.now_s, *seen)

    def silences_s(
        self, since_s: float, tick_ns: int, *, awaits_recorder: bool
    ) -> dict[str, float]:
        """Return the participants that do not answer the roll calls or, if all do, the tick.

        A silence counts from its first roll call on; until then no participant is silent.

        Parameters
        ----------
        awaits_recorder : bool
            Whether the plant waits for the recorder instead of the controller. If every participant
            has answered, the one that the plant waits for counts as silent.

        Returns
        -------
        dict of str to float
            The roles, and how much of the silence counts for each [s]. If some of their processes
            on this machine have died, only those roles, since the other participants may be waiting
            for them.
        """
        if self._since_call is None or self._called_s < since_s:
            # An answer to a roll call of an earlier silence says nothing about this one.
            self._since_call = None
            return {}
        due_ns = _due_ns(tick_ns)
        awaited = CONTROLLER
        if awaits_recorder:
            awaited, due_ns[RECORDER] = RECORDER, 0
        living = self._poll(max(since_s, self._called_s), self._participants())
        # A controller whose tick is done awaits the next one, which the plant has not sent.
        is_owed = not (awaits_recorder or self._roster.has_answered(CONTROLLER, tick_ns))
        found = self._roster.silences_s(
            self._since_call, due_ns, self._silence_s, heeds_awaited=is_owed
        )
        processes = {role: self._process(self._roster.members.get(role)) for role in found}
        gone = [role for role, process in processes.items() if process and process not in living]
        if gone:
            return {role: found[role] for role in gone}
        return found or {awaited: self._silence_s(self._roster.members.get(awaited))}

    def have_confirmed(self, since_call: int, tick_ns: int) -> bool:
        """Return whether all have announced, since a roll call, that they have answered a tick."""
        due_ns = {**_due_ns(tick_ns), CONTROLLER: tick_ns}
        return not self._roster.silences_s(since_call, due_ns, lambda _: 0.0, heeds_awaited=False)

    def waited_s(self, since_s: float) -> float:
        """Return how long the plant has waited for participants to join its run [s]."""
        awaited = [node.process for node in self._roster.awaited_nodes()]
        self._poll(since_s, awaited)
        return min(map(self._timer.silence_s, awaited), default=self._timer.silence_s())

    def _poll(self, since_s: float, processes: Iterable[int]) -> Collection[int]:
        """Update the silence; return the processes that still exist."""
        seen = self._process_observer.observe(processes)
        self._timer.update(since_s, *seen)
        return seen.threads.keys()

    def _participants(self) -> list[int]:
        """Return the participating processes on this machine."""
        processes = map(self._process, self._roster.members.values())
        return [process for process in processes if process is not None]

    def _process(self, participant: Participant | None) -> int | None:
        """Return the process of a participant if it is on this machine."""
        is_here = participant is not None and participant.host == self._host
        return participant.process if participant and is_here else None

    def _silence_s(self, participant: Participant | None) -> float:
        return self._timer.silence_s(self._process(participant))


def _due_ns(tick_ns: int) -> dict[str, int]:
    """Return the stamp that each driver must have answered [ns], and 0 for the controller."""
    due_ns = {role: tick_ns for role in DRIVERS if tick_ns % DRIVER_PERIODS_NS[role] == 0}
    return due_ns | {role: 0 for role in (*DRIVERS, CONTROLLER) if role not in due_ns}
