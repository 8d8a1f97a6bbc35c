"""Playback of a recording: which messages are due at which time."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass
from enum import Enum

from ballbot_ros.errors import RecordingError
from ballbot_ros.parameters.timing import TICK_S
from ballbot_ros.recording.batch import RawMessage
from ballbot_ros.recording.reader import RecordingReader

SKIP_S = 5.0
RATES = (0.1, 0.25, 0.5, 1.0, 2.0, 5.0, 10.0)
"""The speeds among which the keys choose, in multiples of real time."""


class PlaybackAction(str, Enum):
    """What a key or a button does to the playback."""

    START = 'start'
    BACK = 'back'
    PAUSE = 'pause'
    STEP = 'step'
    FORWARD = 'forward'
    END = 'end'
    LOOP = 'loop'
    SLOWER = 'slower'
    FASTER = 'faster'


@dataclass(frozen=True)
class PlaybackKey:
    """A key: its ``KeyboardEvent.key``, what terminals send for it, and what it does in words."""

    action: PlaybackAction
    browser: str
    terminal: tuple[str, ...]
    tip: str


KEYS = (
    PlaybackKey(PlaybackAction.START, 'Home', ('\x1b[H', '\x1bOH', '\x1b[1~'), 'To the start'),
    PlaybackKey(PlaybackAction.BACK, 'ArrowLeft', ('\x1b[D', '\x1bOD'), f'Back by {SKIP_S:g} s'),
    PlaybackKey(PlaybackAction.PAUSE, ' ', (' ',), 'Pause, or play'),
    PlaybackKey(PlaybackAction.STEP, '.', ('.',), 'Pause, and go one tick on'),
    PlaybackKey(
        PlaybackAction.FORWARD, 'ArrowRight', ('\x1b[C', '\x1bOC'), f'Forward by {SKIP_S:g} s'
    ),
    PlaybackKey(PlaybackAction.END, 'End', ('\x1b[F', '\x1bOF', '\x1b[4~'), 'Pause at the end'),
    PlaybackKey(PlaybackAction.LOOP, 'l', ('l',), 'Restart at the end'),
    PlaybackKey(PlaybackAction.SLOWER, '-', ('-',), 'Slower'),
    PlaybackKey(PlaybackAction.FASTER, '+', ('+',), 'Faster'),
)


def terminal_action(key: str) -> PlaybackAction | None:
    """Return what a key does, as a terminal sends it; None if nothing."""
    return next((each.action for each in KEYS if key in each.terminal), None)


class PlaybackClock:
    """Playback time from 0 to `end` [s], at a `rate` in multiples of real time."""

    def __init__(self, end: float, rate: float = 1.0, *, is_looping: bool = False) -> None:
        self.end = end
        self.time = 0.0
        self.rate = rate
        self.is_playing = True
        self.is_looping = is_looping

    def advance(self, seconds: float) -> tuple[float, float]:
        """Let `seconds` of wall time pass; return the played interval [s]."""
        if not self.is_playing:
            return self.time, self.time
        if self.is_looping and self.time >= self.end:
            self.seek(0.0)
        start = self.time
        self.time = min(self.end, start + seconds * self.rate)
        self.is_playing = self.time < self.end or (self.is_looping and self.end > 0.0)
        return start, self.time

    def seek(self, time: float) -> None:
        """Continue from `time` [s], or from the nearer end."""
        self.time = min(max(time, 0.0), self.end)

    def step(self, seconds: float) -> None:
        """Pause, and go on by `seconds` at once."""
        self.is_playing = False
        self.time = min(self.time + seconds, self.end)

    def apply(self, action: PlaybackAction) -> None:
        """Do what a key or a button asks for."""
        match action:
            case PlaybackAction.PAUSE:
                if not self.is_playing and self.time >= self.end:
                    self.seek(0.0)
                self.is_playing = not self.is_playing
            case PlaybackAction.STEP:
                self.step(TICK_S)
            case PlaybackAction.BACK:
                self.seek(self.time - SKIP_S)
            case PlaybackAction.FORWARD:
                self.seek(self.time + SKIP_S)
            case PlaybackAction.START:
                self.seek(0.0)
            case PlaybackAction.END:
                self.is_playing = False
                self.seek(self.end)
            case PlaybackAction.LOOP:
                self.is_looping = not self.is_looping
            case PlaybackAction.SLOWER:
                self.rate = max((each for each in RATES if each < self.rate), default=self.rate)
            case PlaybackAction.FASTER:
                self.rate = min((each for each in RATES if each > self.rate), default=self.rate)


class Playback(PlaybackClock):
    """Plays a recording; its time counts from the oldest message, its end is the newest one.

    The caller provides the wall time: `now` is any monotonic clock [s]. Without `topics`, all are
    played. `first_ns` is the oldest stamp of the file, also of a topic that is not played [ns]. It
    raises RecordingError if there are no messages, or a topic is not in the file.
    """

    def __init__(
        self,
        reader: RecordingReader,
        topics: Collection[str] | None,
        *,
        rate: float,
        is_looping: bool,
    ) -> None:
        if reader.times is None:
            raise RecordingError(f'{reader.path}: no messages to play')
        self.first_ns, last_ns = reader.times
        super().__init__((last_ns - self.first_ns) / 1e9, rate, is_looping=is_looping)
        self._reader = reader
        self._topics = topics
        self.begin(0.0, 0.0)

    def begin(self, start: float, now: float) -> None:
        """Start playing at a time from the oldest message [s]; RecordingError if it is too late."""
        if start > self.end:
            raise RecordingError(
                f'{self._reader.path}: start {start:g} s is after the end, {self.end:g} s'
            )
        self.seek(start)
        self._now = now

    def seek(self, time: float) -> None:
        """Jump to another time, or to the nearest end [s]."""
        super().seek(time)
        self._messages = self._reader.raw_messages(self._topics, self.now_ns)
        self._next = next(self._messages, None)
        self.finished = False

    @property
    def now_ns(self) -> int:
        """The sim time of the playback [ns]."""
        return self.first_ns + round(self.time * 1e9)

    def due(self, now: float) -> Iterator[RawMessage]:
        """Iterate over the messages that have become due since the last call, in file order."""
        if now < self._now:
            return
        was_playing = self.is_playing
        self.advance(now - self._now)
        self._now = now
        until_ns = self.now_ns
        while self._next is not None and self._next.stamp_ns <= until_ns:
            message, self._next = self._next, next(self._messages, None)
            yield message
        self.finished = was_playing and not self.is_playing
