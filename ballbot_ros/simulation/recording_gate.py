"""Which messages of a graph belong into the recording of its runs, and in which order."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import NamedTuple, Protocol

from ballbot_ros.simulation.lockstep import Run
from ballbot_ros.simulation.sample_history import Sample, SampleHistory
from ballbot_ros.timing import SECOND_NS, TICK_NS

MOST_AHEAD_NS = SECOND_NS
"""A sample's stamp further ahead of the clock was made by another clock."""

LATEST_NS = 2 * 3600 * SECOND_NS
"""The same for an event, which may be told of well before it happens, as a push is."""

MOST_PUBLISHERS = 8
"""Publishers of a topic, those before a restart included, whose numbers are kept apart."""


class _Numbers:
    """The newest number of each publisher of a topic; no message tells from whom it is."""

    def __init__(self) -> None:
        self._newest: list[int] = []

    def clear(self) -> None:
        self._newest.clear()

    def follows(self, number: int) -> bool:
        """Tell whether a number is the next one of a publisher."""
        return number - 1 in self._newest

    def leaps(self, number: int) -> bool:
        """Tell whether a number can only be a known publisher's that has left some out."""
        return not self.follows(number) and any(newest < number for newest in self._newest)

    def note(self, number: int) -> None:
        """Take a number for that of the publisher whose newest is next below, or of another."""
        below = [newest for newest in self._newest if newest < number]
        if below:
            self._newest.remove(max(below))
        self._newest.append(number)
        del self._newest[:-MOST_PUBLISHERS]


class Stream:
    """A topic on its way into the recording.

    Parameters
    ----------
    name : str
    period_ns : int
        In lockstep a message comes at each multiple of it [ns]; 0 for a topic of events.
    is_clock : bool
        Whether it tells the time.
    is_live : bool
        Whether nothing of it is left of earlier runs: its publisher begins with its first run,
        or belongs to none.
    is_shared : bool
        Whether several nodes publish it by right, so that gaps in the numbers tell nothing.
    is_same : callable or None
        Whether two messages of one stamp say the same; None for a topic of events.

    Attributes
    ----------
    newest_ns : int
        Stamp of the newest sample of this plant [ns], 0 before the first.
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
        """Begin with another plant."""
        self.newest_ns = 0
        self._numbers.clear()
        if self._history:
            self._history.clear()

    def judge(self, stamp_ns: int, data: bytes, sequence: int) -> Sample:
        """Tell what a message is to those before."""
        if self._history is None:
            return Sample.NEW
        sample = self._history.judge(stamp_ns, data)
        if sample is Sample.NEW:
            self.newest_ns = stamp_ns
        # A stranger's copies have numbers of their own.
        elif sample is Sample.REPEATED and not self._numbers.leaps(sequence):
            self._numbers.note(sequence)
        return sample

    def follows(self, sequence: int) -> bool:
        """Tell whether a number is the next one of a publisher."""
        return self._numbers.follows(sequence)

    def has_lost_before(self, sequence: int) -> bool:
        """Note a publisher's number; tell whether some before it are missing."""
        leaps = self._numbers.leaps(sequence)
        self._numbers.note(sequence)
        return leaps and not self._is_shared

    @property
    def complete_ns(self) -> int:
        """The newest tick [ns] at which nothing of this topic is still to come."""
        return self.newest_ns + self.period_ns - TICK_NS if self.newest_ns else 0


class Writer(Protocol):
    """What carries out the decisions."""

    def keep(self, stream: Stream, log_ns: int, data: bytes, sequence: int) -> None:
        """Write a message with a log time [ns]."""

    def object(self, stream: Stream, stamp_ns: int) -> None:
        """Object to a sample that can't be of the run."""

    def lose(self, stream: Stream, sequence: int) -> None:
        """Tell that messages before a number were lost."""

    def has_several_publishers(self, stream: Stream) -> bool:
        """Tell whether strangers may publish on a topic."""


class _Message(NamedTuple):
    stream: Stream
    stamp_ns: int
    data: bytes
    sequence: int


class RecordingGate:
    """Lets every message of the runs pass, once, and none of another one.

    A sample passes when the clock has come to its stamp: until then nobody of the run can have
    sent it. If one of another content follows it, that one passes, too, so that the run's own is
    in the recording whichever came first, and is objected to.

    Parameters
    ----------
    writer : Writer

    Attributes
    ----------
    now_ns : int
        The newest sim time of this plant [ns], 0 before the first.
    is_lockstep : bool
        Whether each stamp has one sample. Free running, the last one of a stamp is left out.
    takes_part : bool
        Whether the recorder takes part in the runs: no stamp of theirs is then left out. A player
        may leap.
    awaits_run : bool
        Whether there is a plant whose run is not known yet; until it is, nothing passes.
    """

    def __init__(self, writer: Writer) -> None:
        self._writer = writer
        self.is_lockstep = True
        self.awaits_run = False
        self.takes_part = False
        self._run: Run | None = None
        self._first_ns = 0
        self._held: list[_Message] = []
        self.now_ns = 0

    def begin(self, run: Run, streams: Iterable[Stream]) -> bool:
        """Begin another run of some streams; return whether it is another plant's.

        Of the same plant it goes on where the one before has ended, and the last messages of that
        may still come. Another plant sends no sample before everybody has joined its run.
        """
        is_first = self._run is None
        is_another_plants = self._run is None or run.plant != self._run.plant
        self._run, self.awaits_run = run, False
        if is_another_plants:
            self._first_ns, self.now_ns = run.start_ns, 0
            for stream in streams:
                stream.begin()
            held, self._held = self._held, []
            for message in held if is_first else ():
                self.take(*message)
        return is_another_plants

    def take(self, stream: Stream, stamp_ns: int, data: bytes, sequence: int) -> None:
        """Take a message in the order in which it was received.

        Parameters
        ----------
        stream : Stream
        stamp_ns : int
            Its stamp [ns]; 0 if it has none of the run's time.
        data : bytes
        sequence : int
            Its publisher's number.
        """
        message = _Message(stream, stamp_ns, data, sequence)
        if stream.period_ns and stamp_ns < self._first_ns:
            return
        if self.awaits_run:
            self._held.append(message)
        elif stream.is_clock:
            self._take_time(message)
        elif self._is_ahead(message):
            self._writer.object(stream, stamp_ns)
        elif self.now_ns == 0 or (self._run and stream.period_ns and stamp_ns > self.now_ns):
            self._held.append(message)
        else:
            self._pass(message)

    def _take_time(self, message: _Message) -> None:
        is_ahead = self.now_ns and message.stamp_ns > self.now_ns + MOST_AHEAD_NS
        # A player leaps; a clock beside the plant's is another simulation's.
        if is_ahead and self._run and self._writer.has_several_publishers(message.stream):
            self._writer.object(message.stream, message.stamp_ns)
            return
        begins = self.now_ns == 0
        self.now_ns = max(self.now_ns, message.stamp_ns)
        if begins and self._run and self.now_ns == self._first_ns:
            # All have joined the run by now: what they sent before is left of another one.
            self._held = [
                each for each in self._held if each.stream.is_live or each.stamp_ns == self.now_ns
            ]
        self._pass(message)
        if self._held:
            held, self._held = self._held, []
            for each in held:
                self.take(*each)

    def _is_ahead(self, message: _Message) -> bool:
        return bool(
            message.stream.period_ns
            and self.now_ns
            and message.stamp_ns > self.now_ns + MOST_AHEAD_NS
        )

    def _pass(self, message: _Message) -> None:
        stream, stamp_ns, data, sequence = message
        is_expected = bool(self.is_lockstep and self.takes_part and self._run and stream.period_ns)
        is_missed = is_expected and self._is_missed_before(message)
        sample = stream.judge(stamp_ns, data, sequence)
        if sample is Sample.CONTRADICTING and self.is_lockstep:
            self._writer.object(stream, stamp_ns)
        elif sample is not Sample.NEW:
            return
        else:
            has_gap = stream.has_lost_before(sequence)
            if is_expected:
                # A missing number between two stamps without a gap was a repetition's.
                has_gap = is_missed
            elif not stream.period_ns:
                # The numbers of a stranger's events are between those of the run.
                has_gap = has_gap and not self._writer.has_several_publishers(stream)
            if has_gap:
                self._writer.lose(stream, sequence)
        is_of_run = self._first_ns <= stamp_ns <= self.now_ns + LATEST_NS and stamp_ns > 0
        self._writer.keep(stream, stamp_ns if is_of_run else self.now_ns, data, sequence)

    def _is_missed_before(self, message: _Message) -> bool:
        """Tell whether a stream leaps over a stamp of this run where another sender begins.

        One and the same has left the stamp out, if its numbers do not leap: nobody has waited for
        that sample.
        """
        stream = message.stream
        if not (self._run and stream.newest_ns) or stream.follows(message.sequence):
            return False
        return message.stamp_ns > max(stream.newest_ns + stream.period_ns, self._run.start_ns)
