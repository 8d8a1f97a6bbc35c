"""The page of recorded runs: playback controls, and a second run as a ghost."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from ballbot_ros.viewer.page import Page
from ballbot_ros.viewer.panel import PERIOD, Panel
from ballbot_ros.viewer.playback_run import PlaybackRun

RATES = {'0.1×': 0.1, '0.5×': 0.5, '1×': 1.0, '2×': 2.0, '5×': 5.0}
_RATES_WITH_TONES = (0.5, 1.0, 2.0)


class PlaybackClock:
    """Playback time of a run.

    Parameters
    ----------
    end : float
        End of the playback [s].

    Attributes
    ----------
    time : float
        Time in the run [s].
    rate : float
        Seconds of the run per second.
    is_playing : bool
    """

    def __init__(self, end: float) -> None:
        self.end = end
        self.time = 0.0
        self.rate = 1.0
        self.is_playing = True

    def advance(self, seconds: float) -> tuple[float, float]:
        """Let `seconds` of wall time pass; return the played interval [s]."""
        start = self.time
        if not self.is_playing:
            return start, start
        end = self.time = min(self.end, start + seconds * self.rate)
        self.is_playing = end < self.end
        return start, end

    def toggle(self) -> None:
        """Play or pause; at the end, restart."""
        if not self.is_playing and self.time >= self.end:
            self.time = 0.0
        self.is_playing = not self.is_playing


class RecordingPage:
    """Shows recorded runs on a page: a run, and optionally a second one as its ghost.

    Parameters
    ----------
    page : Page
    runs : sequence of PlaybackRun
    """

    def __init__(self, page: Page, runs: Sequence[PlaybackRun]) -> None:
        self._page = page
        self._runs = runs
        self.clock = PlaybackClock(max(run.end for run in runs))
        gui = page.server.gui
        self._panel = Panel(gui)
        with gui.add_folder('Playback', order=1.0):
            self._slider: Any = gui.add_slider(
                'Time [s]', 0.0, max(self.clock.end, 0.01), 0.01, 0.0
            )
            self._button = gui.add_button('Pause')
            rate = gui.add_button_group('Rate', tuple(RATES))
        self._slider.on_update(self._seek)
        self._button.on_click(lambda _: self.clock.toggle())
        rate.on_click(lambda event: self._set_rate(str(event.target.value)))
        self._robots = [
            page.scene.add_robot(name, run.dimensions, ghost=name != 'robot')
            for name, run in zip(('robot', 'ghost'), runs, strict=False)
        ]
        page.show_floor(runs[0].floor_map, runs[0].start)
        self._updates = 0

    def _seek(self, event: Any) -> None:
        if event.client is not None:  # not moved by the clock
            self.clock.time = float(self._slider.value)

    def _set_rate(self, name: str) -> None:
        self.clock.rate = RATES[name]

    def update(self, seconds: float) -> None:
        """Show the state after another `seconds` of wall time."""
        start, end = self.clock.advance(seconds)
        if self.clock.rate in _RATES_WITH_TONES and (tone := self._runs[0].tone(start, end)):
            self._panel.play(tone)
        self.show(self.clock.time, panel=self._updates % PERIOD == 0)
        self._updates += 1

    def show(self, time: float, *, panel: bool) -> None:
        """Show the robots at `time` [s]; with `panel`, also update the panel."""
        snapshot = self._runs[0].snapshot(time)
        for robot, run in zip(self._robots, self._runs, strict=True):
            robot.show(run.snapshot(time))
        self._page.update_cameras(snapshot)
        if panel:
            for robot, run in zip(self._robots, self._runs, strict=True):
                robot.show_trail(run.trail(time))
            self._panel.show(snapshot, self._runs[0].trace(time))
            self._slider.value = round(time, 2)
            self._button.label = 'Pause' if self.clock.is_playing else 'Play'
