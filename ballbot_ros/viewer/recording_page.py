"""The page of recorded runs: playback controls, and a second run as a ghost."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from html import escape
from typing import Any

import numpy as np
import viser

from ballbot_ros.analysis.topic_samples import TopicSamples
from ballbot_ros.errors import RecordingError
from ballbot_ros.process import ProgressCallback
from ballbot_ros.recording.playback import KEYS, RATES, PlaybackAction, PlaybackClock
from ballbot_ros.viewer.live_controls import note
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
from ballbot_ros.viewer.playback_run import PlaybackRun
from ballbot_ros.viewer.plots import (
    PlotData,
    PlotKind,
    Plots,
    recorded_kinds,
    recorded_plot,
    topic_kind,
    whole_plot,
)
from ballbot_ros.viewer.processor_panel import ProcessorPanel
from ballbot_ros.viewer.scene import PERIOD, Scene, ScenePanel


class RecordedRobots:
    """The robot of a run and, if there is a second run, that of the other one as its ghost."""

    def __init__(self, scene: Scene, runs: Sequence[PlaybackRun]) -> None:
        self._runs = runs
        self.drawn = [
            scene.add_robot(name, run.dimensions, ghost=name != 'robot')
            for name, run in zip(('robot', 'ghost'), runs, strict=False)
        ]

    def show(self, time: float) -> None:
        """Show the robots at `time` [s]."""
        for robot, run in zip(self.drawn, self._runs, strict=True):
            robot.show(run.snapshot(time))

    def show_trails(self, time: float) -> None:
        """Show the paths until `time` [s]."""
        for robot, run in zip(self.drawn, self._runs, strict=True):
            robot.show_trail(run.trail(time))


class RecordedTopics:
    """The topics of recorded runs; the messages of a topic are read once, when it is chosen.

    `names` are those whose messages can have numbers, in any of the runs.
    """

    def __init__(self, runs: Sequence[PlaybackRun]) -> None:
        self._topics_of = [(run, frozenset(run.topics())) for run in runs]
        self.names = sorted(frozenset().union(*(names for _, names in self._topics_of)))
        self._samples: dict[PlotKind, tuple[str, list[TopicSamples]]] = {}

    def read(
        self, topic: str, progress: ProgressCallback
    ) -> tuple[dict[str, PlotKind], dict[str, float]]:
        """Read a topic in all runs; return its plots by column, and what never changes.

        Its errors are those of :func:`~ballbot_ros.analysis.topic_samples.read_topic`.
        """
        count = sum(topic in names for _, names in self._topics_of)
        samples: list[TopicSamples] = []
        before = 0
        for run, names in self._topics_of:
            if topic in names:
                samples.append(run.read_topic(topic, _part(progress, before, count)))
                before += 1
            else:
                samples.append(TopicSamples(np.zeros(0), {}))
        changing = dict.fromkeys(name for each in samples for name in each.changing)
        kinds = {name: topic_kind(topic, name) for name in changing}
        self._samples |= {kind: (name, samples) for name, kind in kinds.items()}
        return kinds, _constants(samples, changing)

    def plot(self, kind: PlotKind) -> PlotData | None:
        """Return a plot of :meth:`read`; None if it is another plot.

        It spans the runs, with the samples at their own times. If two runs have samples at
        different times, each keeps its newest value at those of the other.
        """
        if kind not in self._samples:
            return None
        name, samples = self._samples[kind]
        end = max(run.end for run, _ in self._topics_of)
        time = np.unique(np.concatenate([[0.0, end], *(each.time for each in samples)]))
        tables = [
            {name: each.newest(name, time)} if name in each.columns else {} for each in samples
        ]
        return whole_plot(kind, time, tables)


def _part(progress: ProgressCallback, before: int, count: int) -> ProgressCallback:
    """Return the progress of one of `count` equal parts, with the number of those before it."""
    return lambda done, total: progress(before * total + done, count * total)


def _constants(samples: Sequence[TopicSamples], changing: Mapping[str, object]) -> dict[str, float]:
    """Return the values that do not change, of the first run that has them."""
    return {
        name: float(values[0])
        for each in reversed(samples)
        for name, values in each.columns.items()
        if name not in changing
    }


class TopicChooser:
    """Closed folders, one for each topic, in the folder in which plots are chosen.

    viser does not report that a folder is opened. Therefore a button takes the place of a folder
    until then.
    """

    def __init__(
        self, gui: viser.GuiApi, plots: Plots, topics: RecordedTopics, notify: Callable[[str], None]
    ) -> None:
        self._gui, self._plots, self._topics, self._notify = gui, plots, topics, notify
        self._lock = threading.Lock()
        self._opened: set[str] = set()
        with plots.chooser:
            for topic in topics.names:
                button = gui.add_button(topic, color='gray', icon=viser.Icon.CHEVRON_DOWN)
                button.on_click(partial(self._on_click, topic, button))

    def _on_click(self, topic: str, button: viser.GuiButtonHandle, _: object) -> None:
        """Open the folder of a topic; viser calls this in a thread of its own."""
        with self._lock:  # one after the other, and each only once
            if topic not in self._opened:
                self._open(topic, button)

    def _open(self, topic: str, button: viser.GuiButtonHandle) -> None:
        button.disabled = True
        with self._plots.chooser:
            bar: Any = self._gui.add_progress_bar(0.0, order=button.order)

        def show_progress(done: int, total: int) -> None:
            bar.value = 100.0 * done / total

        try:
            kinds, constants = self._topics.read(topic, show_progress)
        except RecordingError as error:
            self._notify(str(error))
            button.disabled = False
            return
        finally:
            bar.remove()
        with self._plots.chooser, self._gui.add_folder(topic, order=button.order):
            self._plots.offer(kinds)
            if constants or not kinds:
                self._gui.add_html(_unchanging(constants))
        button.remove()
        self._opened.add(topic)


def _unchanging(constants: Mapping[str, float]) -> str:
    """Return a note about the columns that have no plot."""
    values = ', '.join(
        f'{escape(name)} {"–" if math.isnan(value) else format(value, "g")}'
        for name, value in constants.items()
    )
    return note(f'never changes: {values}' if values else 'no numbers')


RATE_LABELS = {f'{rate:g}×': rate for rate in RATES}
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


def playback_overlay(
    clock: PlaybackClock, timeline: Timeline, further: Sequence[Button] = ()
) -> OverlayState:
    """Return the transport bar of a playback, with further buttons."""
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
    rates, rate = tuple(RATE_LABELS), f'{clock.rate:g}×'
    return OverlayState(buttons=(*buttons, *further), rates=rates, rate=rate, timeline=timeline)


def take_request(clock: PlaybackClock, request: Request) -> None:
    """Do what a page asks of a playback; ignore what it does not offer."""
    match request:
        case Press(name) if name in _ACTIONS:
            clock.apply(_ACTIONS[name])
        case ChooseRate(rate) if rate in RATE_LABELS:
            clock.rate = RATE_LABELS[rate]
        case Seek(time):
            clock.seek(time)


class RecordingPage:
    """Shows recorded runs on a page: a run, and optionally a second one as its ghost."""

    def __init__(self, page: Page, runs: Sequence[PlaybackRun]) -> None:
        self.page = page
        self.runs = runs
        self.clock = PlaybackClock(max(run.end for run in runs))
        self._timeline = Timeline(self.clock.end, runs[0].marks)
        self.panel = ScenePanel(page.server.gui)
        self.processor = ProcessorPanel(page.server.gui)
        self.plots = Plots(page.server.gui, recorded_kinds(runs))
        self._topics = RecordedTopics(runs)
        TopicChooser(page.server.gui, self.plots, self._topics, page.notify)
        self.robots = RecordedRobots(page.scene, runs)
        page.show_floor(runs[0].floor_map, runs[0].start)
        self.updates = 0

    def update(self, seconds: float) -> None:
        """Show the state after another `seconds` of wall time."""
        self.play(seconds, self.page.overlay.take())

    def play(
        self, seconds: float, requests: Iterable[Request], further: Sequence[Button] = ()
    ) -> None:
        """Show the recorded state after another `seconds`, with further buttons."""
        for request in requests:
            take_request(self.clock, request)
        # Nobody would see the beginning while a slow browser still prepares to draw.
        is_seen = self.page.overlay.is_drawn
        start, end = self.clock.advance(seconds if is_seen else 0.0)
        if self.clock.rate in _RATES_WITH_TONES and (tone := self.runs[0].tone(start, end)):
            self.panel.play(tone)
        self.page.overlay.show(playback_overlay(self.clock, self._timeline, further))
        self.show(self.clock.time, panel=self.updates % PERIOD == 0)
        self.updates += 1

    def show(self, time: float, *, panel: bool) -> None:
        """Show the robots at `time` [s]; with `panel`, also update the panel."""
        snapshot = self.runs[0].snapshot(time)
        self.robots.show(time)
        self.page.update_cameras(snapshot)
        self.page.overlay.move_playhead(time)
        if panel:
            self.robots.show_trails(time)
            self.panel.show(snapshot)
            run, is_still = self.runs[0], not self.clock.is_playing
            until_us, interrupt_us = run.clock_us(time), run.interrupt_us
            self.processor.show(run.jobs if is_still else None, until_us, time, interrupt_us)
            self.plots.update(self.recorded_plot)

    def recorded_plot(self, kind: PlotKind) -> PlotData:
        """Return a plot of the whole runs."""
        return self._topics.plot(kind) or recorded_plot(kind, self.runs)
