"""What belongs in a recording, in which order, and how far the plant may run ahead of it.

A stranger is a node that publishes on a topic of the run without taking part in the run.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from itertools import chain
from operator import itemgetter
from typing import Generic, NamedTuple, Protocol, TypeVar

from ballbot_ros.lockstep.lockstep import RunIdentity, SampleHistory, SampleStatus
from ballbot_ros.lockstep.participants import Participant
from ballbot_ros.parameters import COMMON_PERIOD_NS
from ballbot_ros.parameters.timing import MAX_LEAD_TICKS, SECOND_NS, TICK_NS

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


MAX_AHEAD_NS = SECOND_NS
"""A sample stamped further ahead of sim time than this comes from another clock."""

MAX_EVENT_AHEAD_NS = 2 * 3600 * SECOND_NS
"""The same limit for an event, which may be announced long before it happens, like a push."""

MAX_PUBLISHERS = 8
"""Number of publishers of a topic, including replaced ones, whose sequence numbers are tracked."""


class _Numbers:
    """Newest sequence number of each publisher of a topic, inferred: messages name no sender."""

    def __init__(self) -> None:
        self._newest: list[int] = []

    def clear(self) -> None:
        self._newest.clear()

    def has_gap(self, number: int) -> bool:
        """Return whether `number` can only mean that a known publisher skipped some numbers."""
        return number - 1 not in self._newest and any(newest < number for newest in self._newest)

    def note(self, number: int) -> None:
        """Assign a number to the publisher with the next lower one, or to a new publisher."""
        below = [newest for newest in self._newest if newest < number]
        if below:
            self._newest.remove(max(below))
        self._newest.append(number)
        del self._newest[:-MAX_PUBLISHERS]


class Stream:
    """A topic to be recorded, and what has arrived on it so far.

    Parameters
    ----------
    period_ns : int
        In lockstep, period of its messages [ns]; 0 for a topic of events.
    is_live : bool
        Whether it can't hold messages of earlier runs, because its publisher starts with its first
        run or belongs to no run.
    is_shared : bool
        Whether several nodes publish on it legitimately, so that number gaps mean nothing.
    is_same : callable or None
        Compares the content of two messages with one stamp; None for a topic of events.

    Attributes
    ----------
    newest_ns : int
        Stamp of the newest sample from this plant [ns], 0 before the first.
    """

    def __init__(
        self,
        name: str,
        *,
        period_ns: int = 0,
        is_clock: bool = False,
        is_live: bool = False,
        is_shared: bool = False,
        is_same: Callable[[bytes, bytes], bool] | None = None,
    ) -> None:
        self.name, self.period_ns = name, period_ns
        self.is_clock, self.is_live, self._is_shared = is_clock, is_live, is_shared
        self._history = SampleHistory(is_same) if is_same else None
        self._numbers = _Numbers()
        self.newest_ns = 0

    def begin(self) -> None:
        """Start over with another plant."""
        self.newest_ns = 0
        self._numbers.clear()
        if self._history:
            self._history.clear()

    def classify(self, stamp_ns: int, data: bytes, sequence: int) -> SampleStatus:
        """Return how a message relates to the earlier ones."""
        if self._history is None:
            return SampleStatus.NEW
        sample = self._history.classify(stamp_ns, data)
        if sample is SampleStatus.NEW:
            self.newest_ns = stamp_ns
        # Do not note a number after a gap: a stranger's copies have sequence numbers of their own.
        elif sample is SampleStatus.DUPLICATE and not self._numbers.has_gap(sequence):
            self._numbers.note(sequence)
        return sample

    def has_lost_before(self, sequence: int) -> bool:
        """Note a sequence number; return whether messages before it are missing."""
        leaps = self._numbers.has_gap(sequence)
        self._numbers.note(sequence)
        return leaps and not self._is_shared

    @property
    def complete_ns(self) -> int:
        """The newest tick [ns] for which nothing on this topic is outstanding."""
        return self.newest_ns + self.period_ns - TICK_NS if self.newest_ns else 0


class Writer(Protocol):
    """Carries out the decisions of the gate."""

    def keep(self, stream: Stream, log_ns: int, data: bytes, sequence: int) -> None:
        """Write a message with a log time [ns]."""

    def raise_objection(self, stream: Stream, stamp_ns: int) -> None:
        """Object to a sample that can't belong to the run."""

    def report_loss(self, stream: Stream, sequence: int) -> None:
        """Report that messages before a sequence number were lost."""

    def has_several_publishers(self, stream: Stream) -> bool:
        """Return whether a topic has several publishers, so that one may be a stranger."""


class _Message(NamedTuple):
    stream: Stream
    stamp_ns: int
    data: bytes
    sequence: int


class RecordingGate:
    """Passes each message of the runs exactly once, and no other message.

    A sample passes when the clock has reached its stamp; before that, no participant can have sent
    it. If a sample with the same stamp but other content follows, the gate objects to it, and
    passes it as well, so that the recording has the genuine sample, whichever of the two came
    first.

    Attributes
    ----------
    now_ns : int
        The newest sim time of this plant [ns], 0 before the first.
    is_lockstep : bool
        Whether each stamp has one sample. In free-running mode, only the first sample with a stamp
        is recorded.
    takes_part : bool
        Whether the recorder takes part in the runs, so that no stamp may be skipped. A player, in
        contrast, may jump in time.
    awaits_run : bool
        Whether there is a plant whose run is not known yet; until it is, nothing passes.
    """

    def __init__(self, writer: Writer) -> None:
        self._writer = writer
        self._with_strangers: set[str] = set()
        self.is_lockstep = True
        self.awaits_run = False
        self.takes_part = False
        self._run: RunIdentity | None = None
        self._first_ns = self._late_ns = 0
        self._held: list[_Message] = []
        self.now_ns = 0

    def begin(self, run: RunIdentity, streams: Iterable[Stream]) -> bool:
        """Begin another run with some streams; return whether it belongs to another plant.

        A new run of the same plant continues the old one, whose last messages may still arrive.
        With another plant, everything starts over, and messages held for the previous plant are
        dropped: no plant sends a sample before all participants have joined its run.
        """
        is_first = self._run is None
        is_another_plants = self._run is None or run.plant != self._run.plant
        self._run, self.awaits_run = run, False
        self._with_strangers.clear()
        if is_another_plants:
            self._first_ns, self.now_ns = run.start_ns, 0
            for stream in streams:
                stream.begin()
            held, self._held = self._held, []
            for message in held if is_first else ():
                self.take(*message)
        return is_another_plants

    def take(self, stream: Stream, stamp_ns: int, data: bytes, sequence: int) -> None:
        """Process a message in the order of arrival; a stamp [ns] of 0 is none in sim time."""
        message = _Message(stream, stamp_ns, data, sequence)
        if stream.period_ns and stamp_ns < self._first_ns:
            return
        if self.awaits_run:
            self._held.append(message)
        elif stream.is_clock:
            self._take_time(message)
        elif self._run and stream.period_ns and 0 < self.now_ns < stamp_ns - MAX_AHEAD_NS:
            self._writer.raise_objection(stream, stamp_ns)
        elif self.now_ns == 0 or (self._run and stream.period_ns and stamp_ns > self.now_ns):
            self._held.append(message)
        else:
            self._pass(message)

    def _take_time(self, message: _Message) -> None:
        is_ahead = self.now_ns and message.stamp_ns > self.now_ns + MAX_AHEAD_NS
        # If there is only one clock, a jump is that of a player; a clock next to the plant's
        # belongs to another simulation.
        if is_ahead and self._run and self._may_have_stranger(message.stream):
            self._writer.raise_objection(message.stream, message.stamp_ns)
            return
        if self.takes_part and message.stamp_ns < self.now_ns:
            # The time of a plant never goes back: what came before was sent by an earlier plant,
            # which has left, or this is another one's.
            self._writer.raise_objection(message.stream, message.stamp_ns)
            return
        begins = self.now_ns == 0
        self.now_ns = max(self.now_ns, message.stamp_ns)
        if begins and self._run and self.now_ns == self._first_ns:
            # Keep only messages of live topics and samples of this first tick: all participants
            # have joined the run by now, so anything else was sent in another run.
            self._held = [
                each for each in self._held if each.stream.is_live or each.stamp_ns == self.now_ns
            ]
        self._pass(message)
        if self._held:
            held, self._held = self._held, []
            for each in held:
                self.take(*each)

    def _pass(self, message: _Message) -> None:
        stream, stamp_ns, data, sequence = message
        is_expected = bool(self.is_lockstep and self.takes_part and self._run and stream.period_ns)
        is_missed = is_expected and self._is_missed_before(message)
        is_late = bool(stream.period_ns and not stream.newest_ns and stamp_ns > self._first_ns)
        sample = stream.classify(stamp_ns, data, sequence)
        if sample is SampleStatus.CONFLICTING and self.is_lockstep:
            self._writer.raise_objection(stream, stamp_ns)
        elif sample is not SampleStatus.NEW:
            return
        else:
            if is_late:
                self._late_ns = max(self._late_ns, stamp_ns)
            has_gap = stream.has_lost_before(sequence)
            if is_expected:
                # Judge by the stamps: a number missing between two consecutive stamps was that of
                # a repeated sample.
                has_gap = is_missed
            elif has_gap:
                # Ignore it if a stranger may publish: its numbers lie between those of the run.
                has_gap = not self._may_have_stranger(stream)
            if has_gap:
                self._writer.report_loss(stream, sequence)
        is_of_run = self._first_ns <= stamp_ns <= self.now_ns + MAX_EVENT_AHEAD_NS and stamp_ns > 0
        self._writer.keep(stream, stamp_ns if is_of_run else self.now_ns, data, sequence)

    @property
    def complete_from_ns(self) -> int:
        """Sim time from which on the samples of a run are complete [ns]; 0: from its start on."""
        return self._late_ns if self.takes_part and self.is_lockstep else 0

    def _may_have_stranger(self, stream: Stream) -> bool:
        """Return whether a topic has, or had in this run, several publishers.

        A stranger may go on after the plant has left.
        """
        if self._writer.has_several_publishers(stream):
            self._with_strangers.add(stream.name)
        return stream.name in self._with_strangers

    def _is_missed_before(self, message: _Message) -> bool:
        """Return whether a stream skips a stamp of this run.

        Its numbers do not tell: those of a restarted sender may continue those of the dead one.
        """
        stream = message.stream
        if not (self._run and stream.newest_ns):
            return False
        return message.stamp_ns > max(stream.newest_ns + stream.period_ns, self._run.start_ns)


class RecordedTicks:
    """Tracks the streams that a run requires, and detects complete ticks.

    `acked_ns` is the newest tick reported as complete [ns], 0 before the first.
    """

    def __init__(self) -> None:
        self.begin()

    def begin(self) -> None:
        """Start over with another plant, whose run requires nothing yet."""
        self.acked_ns = 0
        self._required: tuple[Stream, ...] = ()

    def require(self, streams: Iterable[Stream]) -> None:
        """Set the streams of a run: a tick is complete when each of them has its sample."""
        self._required = tuple(streams)

    def advance(self) -> bool:
        """Return whether a newer tick is complete; if so, `acked_ns` is that tick."""
        complete_ns = min((stream.complete_ns for stream in self._required), default=0)
        if complete_ns <= self.acked_ns:
            return False
        self.acked_ns = complete_ns
        return True


class RecorderFlow:
    """Holds the plant back until the recorder has caught up.

    The topics keep nothing for late subscribers. Therefore the plant waits until the recorder has
    completely received the first tick, and each tick that was sent again. `ack_ns` is the newest
    tick that it has acknowledged [ns].
    """

    def __init__(self, start_ns: int) -> None:
        self.recorder: Participant | None = None
        self.ack_ns: int | None = None
        self._newest: Participant | None = None
        self._sync_ns = start_ns

    def begin(self, recorder: Participant | None) -> None:
        """Begin the run with the recorder that has joined it, if any."""
        self.recorder = self._newest = recorder

    def join(self, recorder: Participant | None, now_ns: int) -> bool:
        """Accept a recorder that joins in mid-run; return whether one has.

        The recorder starts at a tick at which every driver sends a sample.
        """
        if recorder == self._newest:
            return False
        self.recorder = self._newest = recorder
        self.ack_ns = None
        self._sync_ns = -(-now_ns // COMMON_PERIOD_NS) * COMMON_PERIOD_NS
        return True

    def leave(self) -> None:
        """Continue without a recorder."""
        self.recorder = self.ack_ns = None

    def require_ack(self, now_ns: int) -> None:
        """Note that a tick was sent again at sim time `now_ns` [ns]."""
        # Wait for the recorder, which may not have discovered yet a participant that has only just
        # answered.
        if self.ack_ns is not None:
            self._sync_ns = now_ns

    def lags(self, now_ns: int) -> bool:
        """Return whether the recorder must catch up before the tick at `now_ns` [ns] ends."""
        if self.recorder is None:
            return False
        if self.ack_ns is None or self.ack_ns < self._sync_ns:
            return now_ns >= self._sync_ns
        return now_ns - self.ack_ns > MAX_LEAD_TICKS * TICK_NS

    def has_all(self, last_ns: int) -> bool:
        """Return whether the recorder has everything up to the last tick [ns]."""
        if self.recorder is None:
            return True
        if self.ack_ns is None:
            return self._sync_ns > last_ns
        return self.ack_ns >= last_ns

    @property
    def next_ns(self) -> int | None:
        """The first tick that the recorder lacks [ns]; None before its first acknowledgement."""
        if self.recorder is None or self.ack_ns is None:
            return None
        return self.ack_ns + TICK_NS
