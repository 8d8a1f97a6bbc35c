"""The page of recorded runs: playback controls, and a second run as a ghost."""

from __future__ import annotations

from collections.abc import Sequence

from ballbot_ros.recording.playback import KEYS, RATES, PlaybackAction
from ballbot_ros.viewer.overlay import (
    Button,
    ChooseRate,
    OverlayState,
    Press,
    Request,
    Seek,
    Timeline,
)
from ballbot_ros.viewer.page import Page
from ballbot_ros.viewer.panel import PERIOD, Panel
from ballbot_ros.viewer.playback_run import PlaybackClock, PlaybackRun
from ballbot_ros.viewer.plots import PlotData, PlotKind, Plots, recorded_kinds, recorded_plot
from ballbot_ros.viewer.recorded_robots import RecordedRobots
from ballbot_ros.viewer.recorded_topics import RecordedTopics, TopicChooser

_RATE_LABELS = {f'{rate:g}×': rate for rate in RATES}
_RATES_WITH_TONES = (0.5, 1.0, 2.0)
_LABELS = {
    PlaybackAction.START: 'Start',
    PlaybackAction.BACK: '−5 s',
    PlaybackAction.STEP: 'Step',
    PlaybackAction.FORWARD: '+5 s',
    PlaybackAction.END: 'End',
    PlaybackAction.LOOP: 'Loop',
}
_ACTIONS = {action.value: action for action in PlaybackAction}


def playback_overlay(clock: PlaybackClock, timeline: Timeline) -> OverlayState:
    """Return the transport bar of a playback."""
    labels = _LABELS | {PlaybackAction.PAUSE: 'Pause' if clock.is_playing else 'Play'}
    buttons = tuple(
        Button(
            key.action.value,
            labels.get(key.action, ''),
            key.browser,
            key.tip,
            is_pressed=key.action is PlaybackAction.LOOP and clock.is_looping,
        )
        for key in KEYS
    )
    return OverlayState(
        buttons=buttons,
        rates=tuple(_RATE_LABELS),
        rate=f'{clock.rate:g}×',
        timeline=timeline,
    )


def take_request(clock: PlaybackClock, request: Request) -> None:
    """Do what a page asks of a playback; ignore what it does not offer."""
    match request:
        case Press(name) if name in _ACTIONS:
            clock.apply(_ACTIONS[name])
        case ChooseRate(rate) if rate in _RATE_LABELS:
            clock.rate = _RATE_LABELS[rate]
        case Seek(time):
            clock.seek(time)


class RecordingPage:
    """Shows recorded runs on a page: a run, and optionally a second one as its ghost."""

    def __init__(self, page: Page, runs: Sequence[PlaybackRun]) -> None:
        self._page = page
        self._runs = runs
        self.clock = PlaybackClock(max(run.end for run in runs))
        self._timeline = Timeline(self.clock.end, runs[0].marks)
        self._panel = Panel(page.server.gui)
        self._plots = Plots(page.server.gui, recorded_kinds(runs))
        self._topics = RecordedTopics(runs)
        TopicChooser(page.server.gui, self._plots, self._topics, page.notify)
        self._robots = RecordedRobots(page.scene, runs)
        page.show_floor(runs[0].floor_map, runs[0].start)
        self._updates = 0

    def update(self, seconds: float) -> None:
        """Show the state after another `seconds` of wall time."""
        for request in self._page.overlay.take():
            take_request(self.clock, request)
        start, end = self.clock.advance(seconds)
        if self.clock.rate in _RATES_WITH_TONES and (tone := self._runs[0].tone(start, end)):
            self._panel.play(tone)
        self._page.overlay.show(playback_overlay(self.clock, self._timeline))
        self.show(self.clock.time, panel=self._updates % PERIOD == 0)
        self._updates += 1

    def show(self, time: float, *, panel: bool) -> None:
        """Show the robots at `time` [s]; with `panel`, also update the panel."""
        snapshot = self._runs[0].snapshot(time)
        self._robots.show(time)
        self._page.update_cameras(snapshot)
        self._page.overlay.move_playhead(time)
        if panel:
            self._robots.show_trails(time)
            self._panel.show(snapshot)
            self._plots.update(self._plot)

    def _plot(self, kind: PlotKind) -> PlotData:
        return self._topics.plot(kind) or recorded_plot(kind, self._runs)
