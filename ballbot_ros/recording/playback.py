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


def faster(rate: float) -> float:
    """Return the next higher speed of :data:`RATES`, or the same if there is none."""
    return min((each for each in RATES if each > rate), default=rate)


def slower(rate: float) -> float:
    """Return the next lower speed of :data:`RATES`, or the same if there is none."""
    return max((each for each in RATES if each < rate), default=rate)


class Playback:
    """Plays a recording at a variable rate.

    The caller provides the time: `now` is any monotonic clock [s].

    Parameters
    ----------
    reader : RecordingReader
    topics : collection of str or None
        The topics to play; None for all.
    rate : float
        Speed in multiples of real time.
    loop : bool
        Whether to restart from the oldest message at the end.

    Attributes
    ----------
    first_ns : int
        The oldest stamp of the file, including topics that are not played [ns].
    duration : float
        Time from there to the newest stamp [s].
    rate : float
        Speed in multiples of real time.
    loop : bool
        Whether to restart from the oldest message at the end.
    paused, finished : bool
        Whether the playback is paused, and whether everything has been played.

    Raises
    ------
    RecordingError
        If there are no messages, or a topic is not in the file.
    """

    def __init__(
        self,
        reader: RecordingReader,
        topics: Collection[str] | None,
        *,
        rate: float,
        loop: bool,
    ) -> None:
        if reader.times is None:
            raise RecordingError(f'{reader.path}: no messages to play')
        self.first_ns, last_ns = reader.times
        self.duration = (last_ns - self.first_ns) / 1e9
        self._reader = reader
        self._topics = topics
        self.loop = loop
        self.rate = rate
        self.paused = False
        self.seek(0.0, 0.0)

    def begin(self, start: float, now: float) -> None:
        """Start playing at `start`, counted from the oldest message [s].

        Raises
        ------
        RecordingError
            If `start` is after the end.
        """
        if start > self.duration:
            raise RecordingError(
                f'{self._reader.path}: start {start:g} s is after the end, {self.duration:g} s'
            )
        self.seek(start, now)

    def position(self, now: float) -> float:
        """Return the position, counted from the oldest message [s]."""
        passed = 0.0 if self.paused else (now - self._anchor) * self.rate
        return min(max(self._position + passed, 0.0), self.duration)

    def set_rate(self, rate: float, now: float) -> None:
        """Continue at another speed."""
        self._position, self._anchor = self.position(now), now
        self.rate = rate

    def pause(self, paused: bool, now: float) -> None:
        """Pause or resume."""
        self._position, self._anchor = self.position(now), now
        self.paused = paused

    def seek(self, position: float, now: float) -> None:
        """Jump to another position, or to the nearest end [s]."""
        self._position, self._anchor = min(max(position, 0.0), self.duration), now
        start_ns = self.first_ns + round(self._position * 1e9)
        self._messages = self._reader.raw_messages(self._topics, start_ns)
        self._next = next(self._messages, None)
        self.finished = False

    def step(self, seconds: float, now: float) -> None:
        """Pause, and play the next `seconds` of the recording at once."""
        self.pause(True, now)
        self._position = min(self._position + seconds, self.duration)

    def apply(self, action: PlaybackAction, now: float) -> None:
        """Do what a key asks for."""
        position = self.position(now)
        match action:
            case PlaybackAction.PAUSE:
                if self.paused and position >= self.duration:
                    self.seek(0.0, now)
                self.pause(not self.paused, now)
            case PlaybackAction.STEP:
                self.step(TICK_S, now)
            case PlaybackAction.BACK:
                self.seek(position - SKIP_S, now)
            case PlaybackAction.FORWARD:
                self.seek(position + SKIP_S, now)
            case PlaybackAction.START:
                self.seek(0.0, now)
            case PlaybackAction.END:
                self.pause(True, now)
                self.seek(self.duration, now)
            case PlaybackAction.LOOP:
                self.loop = not self.loop
            case PlaybackAction.SLOWER:
                self.set_rate(slower(self.rate), now)
            case PlaybackAction.FASTER:
                self.set_rate(faster(self.rate), now)

    def due(self, now: float) -> Iterator[RawMessage]:
        """Iterate over the messages that have become due since the last call, in file order."""
        if now < self._anchor:
            return
        until_ns = self.first_ns + round(self.position(now) * 1e9)
        while self._next is not None and self._next.stamp_ns <= until_ns:
            message, self._next = self._next, next(self._messages, None)
            yield message
        if self._next is None and not self.paused and self.position(now) >= self.duration:
            if self.loop and self.duration > 0.0:
                self.seek(0.0, now)
            else:
                self.finished = True
