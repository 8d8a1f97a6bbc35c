"""Comparison of recorded messages with those of a replay."""

from __future__ import annotations

import math
import struct
from collections import deque
from collections.abc import Iterable
from dataclasses import fields, is_dataclass
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

    Parameters
    ----------
    topics : iterable of Topic
        The compared topics, in the order in which a tick causes their messages.
    """

    def __init__(self, topics: Iterable[Topic]) -> None:
        self._topics = {topic: _Pairs(topic) for topic in topics}
        self._first: dict[Topic, MessageDifference] = {}
        self.compared = 0

    def add_recorded(self, topic: Topic, stamp_ns: int, data: bytes, epoch: int = 0) -> None:
        """Add a recorded message."""
        if pairs := self._topics.get(topic):
            pairs.recorded.append(_Message(epoch, stamp_ns, data))
            self._compare(topic, pairs)

    def add_replayed(self, topic: Topic, stamp_ns: int, data: bytes, epoch: int = 0) -> None:
        """Add a replayed message."""
        if pairs := self._topics.get(topic):
            pairs.replayed.append(_Message(epoch, stamp_ns, data))
            self._compare(topic, pairs)

    def _compare(self, topic: Topic, pairs: _Pairs) -> None:
        if not (pairs.recorded and pairs.replayed):
            return
        recorded, replayed = pairs.recorded.popleft(), pairs.replayed.popleft()
        self.compared += 1
        if topic in self._first or recorded.data == replayed.data:
            return
        if pairs.is_stamped and recorded.moment != replayed.moment:
            is_extra = recorded.moment < replayed.moment
            earlier, text = (recorded, _EXTRA) if is_extra else (replayed, _MISSING)
            self._first[topic] = earlier.difference(topic, text)
        # Compare the content, since padding bytes may differ.
        elif what := pairs.difference(recorded.data, replayed.data):
            self._first[topic] = replayed.difference(topic, what)

    def first_difference(self, *, complete: bool) -> MessageDifference | None:
        """Return the earliest difference; within one tick, the first in causal order.

        If the recording claims to be `complete`, a message without a counterpart is a difference.
        """
        found = dict(self._first)
        if complete:
            for topic, pairs in self._topics.items():
                for waiting, text in ((pairs.recorded, _EXTRA), (pairs.replayed, _MISSING)):
                    if waiting and topic not in found:
                        found[topic] = waiting[0].difference(topic, text)
        order = list(self._topics)
        first = min(
            found,
            key=lambda topic: (found[topic].epoch, found[topic].stamp_ns, order.index(topic)),
            default=None,
        )
        return None if first is None else found[first]


class _Message(NamedTuple):
    """A message with the epoch and the stamp [ns] of its tick."""

    epoch: int
    stamp_ns: int
    data: bytes

    @property
    def moment(self) -> tuple[int, int]:
        return self.epoch, self.stamp_ns

    def difference(self, topic: Topic, what: str) -> MessageDifference:
        return MessageDifference(self.stamp_ns, topic.name, what, self.epoch)


class _Pairs:
    """Messages of a topic that wait for their counterparts."""

    def __init__(self, topic: Topic) -> None:
        self.recorded: deque[_Message] = deque()
        self.replayed: deque[_Message] = deque()
        self.is_stamped = has_stamp(topic.type_name)
        self._type = topic.type_name
        self._decode = decoder(topic.type_name)

    def difference(self, recorded: bytes, replayed: bytes) -> str:
        try:
            message = self._decode(recorded)
        except ValueError as error:
            return f'the recorded message is not a valid {self._type}: {error}'
        return first_difference(message, self._decode(replayed))


def first_difference(recorded: Any, replayed: Any, path: str = '') -> str:
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
    if _same(recorded, replayed):
        return ''
    plain = [each.item() if isinstance(each, np.generic) else each for each in (recorded, replayed)]
    bits = ' (different bits)' if repr(plain[0]) == repr(plain[1]) else ''  # of a NaN
    return f'{path}: recorded {plain[0]!r}, replayed {plain[1]!r}{bits}'


def _same(one: Any, other: Any) -> bool:
    """Return whether two values are bit-identical, including NaN and the sign of zero."""
    if isinstance(one, float | np.floating):
        return struct.pack('d', one) == struct.pack('d', other)
    return bool(one == other)


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
    """

    def __init__(self) -> None:
        self.ticks = 0
        self.differing = 0
        self.first_ns: int | None = None
        self.largest = (0, 0)
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
