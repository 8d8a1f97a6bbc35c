"""How long somebody has been silent, on a machine that may be too busy to let them answer."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

LOOK_S = 0.2
"""The most that counts between two looks: who was not there to look has heard nothing either."""


@dataclass(frozen=True)
class Activity:
    """What the machine has given to a process so far.

    Attributes
    ----------
    cpu_s : float
        Processor time of all its threads [s].
    queued_s : float
        Time for which its threads waited for a processor [s].
    is_due : bool
        Whether one of them waits for a processor or a disk, or has a processor, at present.
    """

    cpu_s: float
    queued_s: float
    is_due: bool

    def had_s(self, before: Activity, span_s: float) -> float:
        """Return how much of the last `span_s` the process could have used [s].

        Parameters
        ----------
        before : Activity
            That of the same process at the beginning of this time.
        span_s : float
            Its length [s].
        """
        used_s, queued_s = self.cpu_s - before.cpu_s, self.queued_s - before.queued_s
        if self.is_due and not used_s and not queued_s:
            return 0.0  # in the queue all the while, which the system counts when it ends
        return min(max(span_s - queued_s, used_s, 0.0), span_s)


class Patience:
    """Counts a silence by the time that the machine gave to each process that could end it.

    One that is stopped or gone, that waits for a message or that computes without an end has had
    its time; one that the machine keeps waiting has not.
    """

    def __init__(self) -> None:
        self._since_s = self._looked_at_s = self._elapsed_s = 0.0
        self._known: dict[int, Activity] = {}
        self._silences_s: dict[int, float] = {}

    def look(self, since_s: float, now_s: float, processes: Mapping[int, Activity]) -> None:
        """Look at a silence.

        Parameters
        ----------
        since_s : float
            When it began, on a clock that only goes forward [s]. Another time than at the look
            before is another silence.
        now_s : float
            The time on the same clock [s].
        processes : mapping of int to Activity
            Those that could end it, as far as they are on this machine, by process id.
        """
        if since_s != self._since_s:
            self._since_s = self._looked_at_s = since_s
            self._elapsed_s = 0.0
            self._known.clear()
            self._silences_s.clear()
        span_s = min(now_s - self._looked_at_s, LOOK_S)
        self._looked_at_s = now_s
        self._elapsed_s += span_s
        for process in self._silences_s.keys() | processes.keys():
            activity, before = processes.get(process), self._known.get(process)
            had_s = activity.had_s(before, span_s) if activity and before else span_s
            self._silences_s[process] = self._silences_s.get(process, 0.0) + had_s
        self._known = dict(processes)

    def silence_s(self, process: int | None = None) -> float:
        """Return how much of it counts for a process [s]; None stands for one that is elsewhere."""
        if process is None:
            return self._elapsed_s
        return self._silences_s.get(process, self._elapsed_s)
