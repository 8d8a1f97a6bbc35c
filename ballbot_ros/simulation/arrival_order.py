"""The order in which messages of several topics arrived."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from itertools import chain
from operator import itemgetter
from typing import Generic, TypeVar

Message = TypeVar('Message')
"""A message of a topic."""

Arrival = tuple[int, Message]
"""Arrival time of a message by the system clock [ns], and the message."""


class ArrivalOrder(Generic[Message]):
    """Merges messages that are read topic by topic into the order of their arrival.

    A message that arrives during a pass over the topics waits for the next pass, because an older
    message of a topic already read may still be unread. If the system clock is set back in the
    meantime, messages of one topic keep their order, and no message waits for the clock to catch
    up.
    """

    def __init__(self) -> None:
        self._cutoff_ns = 0.0
        self._late: dict[str, list[Arrival[Message]]] = {}

    def merge(
        self, unmerged: Mapping[str, Iterable[Arrival[Message]]], cutoff_ns: float
    ) -> list[Message]:
        """Return the messages that had arrived when the pass began, in order of arrival.

        `unmerged` has the messages of each topic that were read in this pass, oldest first. The
        pass began at `cutoff_ns` by the system clock [ns]; infinite to hold nothing back.
        """
        before: list[Arrival[Message]] = []
        waiting, self._late = self._late, {}
        is_set_back = cutoff_ns < self._cutoff_ns
        self._cutoff_ns = cutoff_ns
        if is_set_back:
            # The clock was set back, so old and new times can't be compared: return all waiting
            # messages first, since they are old, and hold no message back in this pass.
            before, waiting = sorted(chain(*waiting.values()), key=itemgetter(0)), {}
            cutoff_ns = math.inf
        come: list[Arrival[Message]] = []
        for topic, arrivals in unmerged.items():
            newest_ns = 0
            for received_ns, message in chain(waiting.get(topic, ()), arrivals):
                if received_ns > newest_ns:
                    newest_ns = received_ns
                if newest_ns <= cutoff_ns:
                    come.append((newest_ns, message))
                else:
                    self._late.setdefault(topic, []).append((newest_ns, message))
        come.sort(key=itemgetter(0))
        return [message for _, message in chain(before, come)]
