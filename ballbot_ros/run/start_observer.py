"""Observer of a run that starts at a key press."""

from __future__ import annotations

from ballbot_ros.run.observer import RunObserver
from ballbot_ros.teleop.key_press import KeyPress


class StartObserver:
    """Passes on what it is told; once the run has started, no longer waits for a key."""

    def __init__(self, observer: RunObserver, key_press: KeyPress) -> None:
        self._observer, self._key_press = observer, key_press
        self.notice = observer.notice

    def update(self, elapsed_s: float) -> None:
        """Show the sim time since the start [s]."""
        if elapsed_s:
            self._key_press.close()
        self._observer.update(elapsed_s)
