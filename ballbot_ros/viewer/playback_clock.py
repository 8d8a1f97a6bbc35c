"""The time at which a page shows recorded runs."""

from __future__ import annotations

from ballbot_ros.recording.playback_keys import SKIP_S, PlaybackAction, faster, slower
from ballbot_ros.timing import TICK_S


class PlaybackClock:
    """Playback time of a run up to `end` [s].

    Attributes
    ----------
    time : float
        The shown time, from 0 to `end` [s].
    rate : float
        Seconds of the run per second.
    is_looping : bool
        Whether the run restarts at its end.
    """

    def __init__(self, end: float) -> None:
        self.end = end
        self.time = 0.0
        self.rate = 1.0
        self.is_playing = True
        self.is_looping = False

    def advance(self, seconds: float) -> tuple[float, float]:
        """Let `seconds` of wall time pass; return the played interval [s]."""
        if not self.is_playing:
            return self.time, self.time
        if self.is_looping and self.time >= self.end:
            self.time = 0.0
        start = self.time
        self.time = min(self.end, start + seconds * self.rate)
        self.is_playing = self.is_looping or self.time < self.end
        return start, self.time

    def seek(self, time: float) -> None:
        """Continue from `time` [s], or from the nearer end."""
        self.time = min(max(time, 0.0), self.end)

    def apply(self, action: PlaybackAction) -> None:
        """Do what a key or a button asks for."""
        match action:
            case PlaybackAction.PAUSE:
                self._toggle()
            case PlaybackAction.STEP:
                self.is_playing = False
                self.seek(self.time + TICK_S)
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
                self.rate = slower(self.rate)
            case PlaybackAction.FASTER:
                self.rate = faster(self.rate)

    def _toggle(self) -> None:
        """Play or pause; at the end, restart."""
        if not self.is_playing and self.time >= self.end:
            self.time = 0.0
        self.is_playing = not self.is_playing
