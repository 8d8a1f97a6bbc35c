"""The page of recorded runs: playback controls, and a second run as a ghost."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from queue import SimpleQueue
from typing import Any

from ballbot_ros.viewer.page import Page
from ballbot_ros.viewer.panel import PERIOD, Panel
from ballbot_ros.viewer.playback_run import PlaybackRun
from ballbot_ros.viewer.plots import Plots
from ballbot_ros.viewer.recorded_plots import recorded_kinds, recorded_plot
from ballbot_ros.viewer.recorded_robots import RecordedRobots

RATES = {'0.1×': 0.1, '0.5×': 0.5, '1×': 1.0, '2×': 2.0, '5×': 5.0}
_RATES_WITH_TONES = (0.5, 1.0, 2.0)


class PlaybackClock:
    """Playback time of a run up to `end` [s]; `rate` is in seconds of the run per second."""

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

    def seek(self, time: float) -> None:
        """Continue from `time` [s]."""
        self.time = time

    def set_rate(self, rate: float) -> None:
        """Continue with `rate` seconds of the run per second."""
        self.rate = rate


class RecordingPage:
    """Shows recorded runs on a page: a run, and optionally a second one as its ghost.

    Only the thread that updates the page touches the clock: users' requests wait in a queue for the
    next update. viser calls coroutines in its event loop, one message after the other. Callbacks
    are therefore coroutines, which keeps the requests in order. The clock moves the slider in the
    event loop, too, so that it can't do so between a user's move and its callback.
    """

    def __init__(self, page: Page, runs: Sequence[PlaybackRun]) -> None:
        self._page = page
        self._runs = runs
        self.clock = PlaybackClock(max(run.end for run in runs))
        gui = page.server.gui
        self._panel = Panel(gui)
        self._plots = Plots(gui, recorded_kinds(runs))
        with gui.add_folder('Playback', order=1.0):
            self._slider: Any = gui.add_slider(
                'Time [s]', 0.0, max(self.clock.end, 0.01), 0.01, 0.0
            )
            self._button = gui.add_button('Pause')
            rate = gui.add_button_group('Rate', tuple(RATES))
        self._requests: SimpleQueue[Callable[[], None]] = SimpleQueue()
        self._slider.on_update(self._on_slider)
        self._button.on_click(self._on_button)
        rate.on_click(self._on_rate)
        self._robots = RecordedRobots(page.scene, runs)
        page.show_floor(runs[0].floor_map, runs[0].start)
        self._updates = 0

    async def _on_slider(self, event: Any) -> None:
        if event.client is not None:  # moved by a user, not by the clock
            self._requests.put(partial(self.clock.seek, float(self._slider.value)))

    async def _on_button(self, _: Any) -> None:
        self._requests.put(self.clock.toggle)

    async def _on_rate(self, event: Any) -> None:
        self._requests.put(partial(self.clock.set_rate, RATES[str(event.target.value)]))

    def _move_slider(self, time: float) -> None:
        if self._requests.empty():
            self._slider.value = round(time, 2)

    def update(self, seconds: float) -> None:
        """Show the state after another `seconds` of wall time."""
        while not self._requests.empty():
            self._requests.get()()
        start, end = self.clock.advance(seconds)
        if self.clock.rate in _RATES_WITH_TONES and (tone := self._runs[0].tone(start, end)):
            self._panel.play(tone)
        self.show(self.clock.time, panel=self._updates % PERIOD == 0)
        self._updates += 1

    def show(self, time: float, *, panel: bool) -> None:
        """Show the robots at `time` [s]; with `panel`, also update the panel."""
        snapshot = self._runs[0].snapshot(time)
        self._robots.show(time)
        self._page.update_cameras(snapshot)
        if panel:
            self._robots.show_trails(time)
            self._panel.show(snapshot)
            self._plots.update(lambda kind: recorded_plot(kind, self._runs))
            self._page.server.get_event_loop().call_soon_threadsafe(self._move_slider, time)
            self._button.label = 'Pause' if self.clock.is_playing else 'Play'
