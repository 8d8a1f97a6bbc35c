"""Comparison of recorded messages with those of a replay."""

from __future__ import annotations

import math
import struct
from collections.abc import Iterable, Sequence
from dataclasses import fields, is_dataclass
from itertools import repeat
from typing import Any, NamedTuple

import numpy as np

from ballbot_ros.recording.messages.raw import decoder, has_stamp
from ballbot_ros.recording.messages.topics import Topic

_EXTRA, _MISSING = 'recorded but not replayed', 'replayed but not recorded'


class MessageDifference(NamedTuple):
    """A difference between a recorded and a replayed message, at the sim time of a tick [ns].

    `what` is the first differing field with both values, or that the message has no counterpart.
    """

    stamp_ns: int
    topic: str
    what: str
    epoch: int = 0


class MessageComparator:
    """Pairs recorded and replayed messages, topic by topic and in order.

    The topics are in the order in which a tick causes their messages.
    """

    def __init__(self, topics: Iterable[Topic]) -> None:
        self._topics = {topic: _Pairs(topic) for topic in topics}

    def add_recorded(
        self, topic: Topic, stamps_ns: Sequence[int], data: Sequence[bytes], epoch: int = 0
    ) -> None:
        """Add recorded messages of a topic."""
        if pairs := self._topics.get(topic):
            pairs.recorded.extend(epoch, stamps_ns, data)
            pairs.compare_many()

    def add_replayed(
        self, topic: Topic, stamps_ns: Sequence[int], data: Sequence[bytes], epoch: int = 0
    ) -> None:
        """Add replayed messages of a topic."""
        if pairs := self._topics.get(topic):
            pairs.replayed.extend(epoch, stamps_ns, data)
            pairs.compare_many()

    def compared(self, topics: Iterable[Topic] | None = None) -> int:
        """Return the number of compared messages, of all topics or of some."""
        pairs = (each for topic, each in self._topics.items() if topics is None or topic in topics)
        return sum(each.compare() for each in pairs)

    def first_difference(self, *, complete: bool) -> MessageDifference | None:
        """Return the earliest difference; within one tick, the first in causal order.

        If the recording claims to be `complete`, a message without a counterpart is a difference.
        """
        found = []
        for order, pairs in enumerate(self._topics.values()):
            pairs.compare()
            if first := pairs.first or (pairs.unpaired() if complete else None):
                found.append((first.epoch, first.stamp_ns, order, first))
        return min(found)[-1] if found else None


_MANY = 256
"""Number of messages to compare at once: lists of bytes are compared much faster than messages."""


class _Waiting:
    """Messages of a topic that wait for their counterparts.

    `moments` are the epochs and stamps of their ticks [ns].
    """

    def __init__(self) -> None:
        self.moments: list[tuple[int, int]] = []
        self.data: list[bytes] = []

    def extend(self, epoch: int, stamps_ns: Sequence[int], data: Sequence[bytes]) -> None:
        self.moments += zip(repeat(epoch), stamps_ns)
        self.data += data

    def difference(self, at: int, topic: Topic, what: str) -> MessageDifference:
        epoch, stamp_ns = self.moments[at]
        return MessageDifference(stamp_ns, topic.name, what, epoch)

    def drop(self, count: int) -> None:
        del self.moments[:count], self.data[:count]


class _Pairs:
    """The messages of a topic: those not compared yet, and the first difference of the others."""

    def __init__(self, topic: Topic) -> None:
        self.recorded, self.replayed = _Waiting(), _Waiting()
        self.first: MessageDifference | None = None
        self._topic, self._compared = topic, 0
        self._is_stamped = has_stamp(topic.type_name)
        self._decode = decoder(topic.type_name)

    def compare_many(self) -> None:
        """Compare what has its counterpart, if it is much."""
        if len(self.recorded.data) >= _MANY and len(self.replayed.data) >= _MANY:
            self.compare()

    def compare(self) -> int:
        """Compare what has its counterpart; return the number of all compared messages."""
        recorded, replayed = self.recorded, self.replayed
        count = min(len(recorded.data), len(replayed.data))
        if self.first is None and recorded.data[:count] != replayed.data[:count]:
            differences = map(self._difference, range(count))
            self.first = next(filter(None, differences), None)
        self._compared += count
        recorded.drop(count)
        replayed.drop(count)
        return self._compared

    def unpaired(self) -> MessageDifference | None:
        """Return the first message without a counterpart, after :meth:`compare`."""
        for waiting, text in ((self.recorded, _EXTRA), (self.replayed, _MISSING)):
            if waiting.data:
                return waiting.difference(0, self._topic, text)
        return None

    def _difference(self, at: int) -> MessageDifference | None:
        """Return the difference of a pair, if any."""
        recorded, replayed = self.recorded, self.replayed
        if recorded.data[at] == replayed.data[at]:
            return None
        if self._is_stamped and recorded.moments[at] != replayed.moments[at]:
            is_extra = recorded.moments[at] < replayed.moments[at]
            earlier, text = (recorded, _EXTRA) if is_extra else (replayed, _MISSING)
            return earlier.difference(at, self._topic, text)
        # Compare the content, since padding bytes may differ.
        try:
            message = self._decode(recorded.data[at])
        except ValueError as error:
            what = f'the recorded message is not a valid {self._topic.type_name}: {error}'
        else:
            what = first_difference(message, self._decode(replayed.data[at]))
        return replayed.difference(at, self._topic, what) if what else None


def first_difference(recorded: object, replayed: Any, path: str = '') -> str:
    """Return name and values of the first field in which two messages differ; '' if in none."""
    if is_dataclass(recorded):
        for each in fields(recorded):
            name = f'{path}.{each.name}' if path else each.name
            pair = getattr(recorded, each.name), getattr(replayed, each.name)
            if text := first_difference(*pair, name):
                return text
        return ''
    if isinstance(recorded, list | np.ndarray):
        if len(recorded) != len(replayed):
            return f'{path} has {len(recorded)} elements recorded, {len(replayed)} replayed'
        for index, pair in enumerate(zip(recorded, replayed, strict=True)):
            if text := first_difference(*pair, f'{path}[{index}]'):
                return text
        return ''
    if isinstance(recorded, float | np.floating):  # also NaN and the sign of zero
        is_same = struct.pack('d', recorded) == struct.pack('d', replayed)
    else:
        is_same = bool(recorded == replayed)
    if is_same:
        return ''
    plain = [each.item() if isinstance(each, np.generic) else each for each in (recorded, replayed)]
    bits = ' (different bits)' if repr(plain[0]) == repr(plain[1]) else ''  # of a NaN
    return f'{path}: recorded {plain[0]!r}, replayed {plain[1]!r}{bits}'


class Divergence:
    """Collects pairs of duties, tick by tick.

    Attributes
    ----------
    ticks, differing : int
        Number of ticks, and of ticks in which a duty differs.
    first_ns : int or None
        Sim time of the first difference [ns].
    largest : tuple of int
        Largest absolute difference of planes x and y [%].
    jobs : MessageDifference or None
        The first difference of the brick's jobs, if they were recorded.
    """

    def __init__(self) -> None:
        self.ticks = 0
        self.differing = 0
        self.first_ns: int | None = None
        self.largest = (0, 0)
        self.jobs: MessageDifference | None = None
        self._squares = (0, 0)

    def add(self, stamp_ns: int, one: tuple[int, int], other: tuple[int, int]) -> None:
        """Add the duties of a tick."""
        self.ticks += 1
        if one == other:
            return
        self.differing += 1
        if self.first_ns is None:
            self.first_ns = stamp_ns
        x, y = abs(one[0] - other[0]), abs(one[1] - other[1])
        self.largest = max(self.largest[0], x), max(self.largest[1], y)
        self._squares = self._squares[0] + x * x, self._squares[1] + y * y

    @property
    def rms(self) -> tuple[float, float]:
        """Root mean square of the differences of planes x and y [%]."""
        count = max(1, self.ticks)
        return math.sqrt(self._squares[0] / count), math.sqrt(self._squares[1] / count)
