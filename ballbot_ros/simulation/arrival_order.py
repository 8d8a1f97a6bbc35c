"""In which order messages of several topics came."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from itertools import chain
from operator import itemgetter
from typing import Generic, TypeVar

Message = TypeVar('Message')
Arrival = tuple[int, Message]
"""When a message came, by the system clock [ns], and the message."""


class ArrivalOrder(Generic[Message]):
    """Merges what is taken from one topic after the other, by the time at which it came.

    What comes while the topics are looked at one by one waits for the next time: of an earlier
    topic there may be something older. The system clock may be set meanwhile: within a topic the
    order of taking holds all the same, and nothing waits until a clock that was set back is there
    again.
    """

    def __init__(self) -> None:
        self._looked_ns = 0.0
        self._late: dict[str, list[Arrival[Message]]] = {}

    def merge(
        self, taken: Mapping[str, Iterable[Arrival[Message]]], looked_ns: float
    ) -> list[Message]:
        """Return what had come when the first topic was looked at, in order.

        Parameters
        ----------
        taken : mapping
            By name of the topic what was taken of it since the last time, oldest first.
        looked_ns : float
            When that began, by the system clock [ns]; infinite if nothing is to wait.
        """
        before: list[Arrival[Message]] = []
        waiting, self._late = self._late, {}
        is_set_back = looked_ns < self._looked_ns
        self._looked_ns = looked_ns
        if is_set_back:
            # Times from before and after can't be compared, and all that waits is from before.
            before, waiting = sorted(chain(*waiting.values()), key=itemgetter(0)), {}
            looked_ns = math.inf
        come: list[Arrival[Message]] = []
        for topic, arrivals in taken.items():
            newest_ns = 0
            for received_ns, message in chain(waiting.get(topic, ()), arrivals):
                if received_ns > newest_ns:
                    newest_ns = received_ns
                if newest_ns <= looked_ns:
                    come.append((newest_ns, message))
                else:
                    self._late.setdefault(topic, []).append((newest_ns, message))
        come.sort(key=itemgetter(0))
        return [message for _, message in chain(before, come)]
