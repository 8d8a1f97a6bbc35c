"""Measures the silence of a process, on a machine that may be too busy to let it answer."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

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
