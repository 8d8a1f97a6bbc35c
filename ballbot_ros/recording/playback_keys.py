"""The keys that control the playback of a recording, in a terminal and on a page."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

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
