"""The page of a recorded run that becomes live at any moment, with the earlier run as a ghost."""

from __future__ import annotations

import math
import queue
import time
from collections.abc import Callable, Sequence
from concurrent.futures import Future
from pathlib import Path
from threading import Thread

import numpy as np

from ballbot_ros.controllers.interface import OUT_OF_CONTROL, Program
from ballbot_ros.engine.closed_loop import Tick
from ballbot_ros.errors import BallbotError
from ballbot_ros.parameters.timing import FIRST_TICK_NS, SECOND_NS, TICK_S
from ballbot_ros.recording.messages.conversions import NO_CONTROLLER_STATE, ControllerState
from ballbot_ros.robot.arithmetic import Floats
from ballbot_ros.robot.brick.sensors import sonar_cm_to_metres
from ballbot_ros.robot.plant.ground_truth import Pair
from ballbot_ros.run.continued_run import ContinuedRun
from ballbot_ros.viewer.live_controls import FaultChooser, PageSticks, add_push_buttons, drag_push
from ballbot_ros.viewer.overlay import (
    Banner,
    BannerKind,
    Button,
    ChooseRate,
    Hold,
    Mark,
    MarkKind,
    OverlayState,
    Press,
    Request,
    Seek,
    Timeline,
)
from ballbot_ros.viewer.page import Page
from ballbot_ros.viewer.playback_run import PlaybackRun
from ballbot_ros.viewer.plots import PlotData, PlotKind, ghost_columns, plot_data
from ballbot_ros.viewer.recording_page import RATE_LABELS, RecordingPage, take_request
from ballbot_ros.viewer.scene import PERIOD
from ballbot_ros.viewer.shapes import ForceArrow
from ballbot_ros.viewer.snapshot import WINDOW_S, History, Snapshot
from ballbot_ros.viewer.tuning_sliders import Tunable, TuningSliders

LIVE = Button('live', 'Live', 'g', 'Go on from here in another way')
_PAUSE, _STEP, _AGAIN, _KEEP, _LEAVE = 'pause', 'step', 'again', 'keep', 'leave'

_LONGEST_UPDATE_S = 0.1
"""A page that was busy for longer does not catch up."""

_PERIOD_S = 5.0 * TICK_S
"""Of the samples of the recorded run in the plots of a live one."""


class ContinuedPage(RecordingPage):
    """Shows recorded runs, and the first of them from a moment on as somebody changes it.

    `make` returns what continues the first run, or raises BallbotError; it is called in a thread.
    `told` takes the path of each recording that is written.
    """

    def __init__(
        self,
        page: Page,
        runs: Sequence[PlaybackRun],
        make: Callable[[], ContinuedRun],
        told: Callable[[Path], None],
    ) -> None:
        super().__init__(page, runs)
        self._told = told
        self._made: Future[ContinuedRun] = Future()
        Thread(target=_fill, args=(self._made, make), daemon=True).start()
        self._run: ContinuedRun | None = None  # while it is live
        self._is_playing = True
        self._todo: queue.SimpleQueue[Callable[[ContinuedRun], None]] = queue.SimpleQueue()
        self._sticks = PageSticks()
        self._history = History()
        self._tables: dict[PlotKind, dict[str, Floats]] = {}  # of the earlier run
        self._shown = runs[0].snapshot(0.0)
        self._since_tick = 0.0
        self._banner: Banner | None = None
        gui, scene = page.server.gui, page.scene
        self._earlier = scene.add_robot('earlier', runs[0].dimensions, ghost=True)
        self._earlier.hide()
        drag = drag_push(ForceArrow(page.server.scene, 'drag', with_size=True), self._push)
        self.robots.drawn[0].on_drag(drag)
        self._pushes = add_push_buttons(gui, self._push)
        self._faults = FaultChooser(gui, lambda text: self._do(lambda run: run.add_fault(text)))
        self._sliders = TuningSliders(gui)
        self._show_controls(are_live=False)

    def close(self) -> None:
        """End what runs in the background."""
        if self._made.done() and self._made.exception() is None:
            self._made.result().close()

    def _do(self, act: Callable[[ContinuedRun], None]) -> None:
        """Do something to the live run at the next update; called from the page's threads."""
        self._todo.put(act)

    def _push(self, force: Pair) -> None:
        self._do(lambda run: run.push(force))

    def _show_controls(self, *, are_live: bool) -> None:
        self._pushes.visible = self._faults.folder.visible = are_live
        self._sliders.show(_tunables(self._run) if self._run else ())

    def update(self, seconds: float) -> None:
        """Show the state after another `seconds` of wall time."""
        requests, live = self.page.overlay.take(), Press(LIVE.name)
        if self._run is None and (self._todo.qsize() or live in requests):
            while requests and (request := requests.pop(0)) != live:
                take_request(self.clock, request)  # from before, as on a page that was busy
            self._go_live(self.clock.time)
        elif self._run is None:
            self.play(seconds, requests, further=(LIVE,))
        if self._run is not None:
            self._update(self._run, min(seconds, _LONGEST_UPDATE_S), requests)

    def _go_live(self, time: float) -> None:
        """Let the robot be live from a moment on [s]."""
        try:
            run = self._made.result()
            self._go_to(run, time)
        except BallbotError as error:
            self._refuse(error)
            return
        self._run, self.clock.is_playing = run, False
        self.processor.show(None, 0, 0.0)
        for ghost in self.robots.drawn[1:]:
            ghost.hide()
        self._show_controls(are_live=True)

    def _refuse(self, error: BallbotError) -> None:
        while not self._todo.empty():
            self._todo.get()
        self.page.notify(str(error))

    def _go_to(self, run: ContinuedRun, time: float) -> None:
        run.go_to(time)
        self._is_playing, self._since_tick, self._banner = True, 0.0, None
        self._history.forget(run.time)
        if run.time == run.begun:
            self._history.clear()
            first = max(0.0, run.time - WINDOW_S)
            for recorded in np.arange(first, run.time, _PERIOD_S).tolist():
                self._history.add(self.runs[0].snapshot(recorded, rolls=False))
            self._shown = self.runs[0].snapshot(run.time)
        self._sliders.follow({each.name: each.value for each in _tunables(run)})

    def _leave(self, run: ContinuedRun) -> None:
        """Play the recorded run again."""
        self.clock.seek(run.time)
        self._run = None
        self._earlier.hide()
        self._show_controls(are_live=False)
        self.plots.refresh(self.recorded_plot)

    def _update(self, run: ContinuedRun, seconds: float, requests: Sequence[Request]) -> None:
        try:
            for request in requests:
                self._take(run, request)
            while not self._todo.empty():
                self._todo.get()(run)
            for name, numbers in self._sliders.take().items():
                tunable = {each.name: each for each in _tunables(run)}[name]
                run.retune({name: tunable.value_of(numbers)})
        except BallbotError as error:
            self._refuse(error)
            self._sliders.follow({each.name: each.value for each in _tunables(run)})
        if self._run is None:
            return
        try:
            self._advance(run, seconds)
        except BallbotError as error:  # of the controller
            self._stop(str(error))
        self._show_live(run)

    def _take(self, run: ContinuedRun, request: Request) -> None:
        match request:
            case Hold():
                self._sticks.hold(request)
            case Press(name) if name == _PAUSE:
                self._is_playing, self._banner = not self._is_playing, None
            case Press(name) if name == _STEP:
                self._is_playing, self._since_tick = False, TICK_S
            case Press(name) if name == _AGAIN:
                self._go_to(run, run.begun)
            case Press(name) if name == _KEEP:
                self._keep(run)
            case Press(name) if name == _LEAVE:
                self._leave(run)
            case ChooseRate(rate) if rate in RATE_LABELS:
                self.clock.rate = RATE_LABELS[rate]
            case Seek(time):
                self._go_to(run, time)

    def _keep(self, run: ContinuedRun) -> None:
        self._is_playing = False
        if recording := run.keep(_Keeping(self.page, run.time)):
            self._told(recording)
            self._banner = Banner('kept', BannerKind.GOOD, (str(recording),))

    def _advance(self, run: ContinuedRun, seconds: float) -> None:
        self._since_tick += seconds * self.clock.rate if self._is_playing else 0.0
        sticks = self._sticks.value(time.monotonic())
        while self._since_tick >= TICK_S:
            self._since_tick -= TICK_S
            if sticks is not None or run.is_driven:
                run.hold(sticks or (0.0, 0.0))
            tick = run.advance()
            if tick is None:
                self._stop(f'stopped: {run.wall_hit}')
                return
            self._shown = _after(self._shown, tick, run)
            self._history.add(self._shown)
            if tick.outputs.tones:
                self.panel.play(tick.outputs.tones[-1])

    def _stop(self, text: str) -> None:
        self._is_playing = False
        self._banner = Banner(text, BannerKind.BAD, ('Again, or r, returns',))

    def _show_live(self, run: ContinuedRun) -> None:
        self.page.overlay.show(self._overlay(run))
        self.page.overlay.move_playhead(run.time)
        self.page.update_cameras(self._shown)
        robot = self.robots.drawn[0]
        robot.show(self._shown)
        self._earlier.show(self.runs[0].snapshot(run.time))
        if self.updates % PERIOD == 0:
            before = self.runs[0].trail(run.begun - WINDOW_S)
            robot.show_trail([*before, *self._history.trail()])
            self.panel.show(self._shown)
            self.plots.refresh(self._live_plot)
        self.updates += 1

    def _overlay(self, run: ContinuedRun) -> OverlayState:
        banner = self._banner
        if banner is None and self._shown.is_out_of_control:
            text = 'out of control, the motors are off'
            banner = Banner(text, BannerKind.BAD, ('Again, or r, returns',))
        begun = f'{run.begun:.2f} s'
        hint = 'drag the robot, drive, or choose on the right'
        recorded = self.runs[0]
        mark = Mark(run.begun, MarkKind.STATE, 'live from here')
        return OverlayState(
            banner=banner or Banner(f'live since {begun}', BannerKind.INFO, (hint,)),
            buttons=(
                Button(_PAUSE, 'Pause', ' ', 'Pause, or resume', is_pressed=not self._is_playing),
                Button(_STEP, 'Step', '.', 'Pause, and go one tick on'),
                Button(_AGAIN, 'Again', 'r', f'Return to {begun}'),
                Button(_KEEP, 'Keep', 'k', 'Write the recording of this run'),
                Button(_LEAVE, 'Recorded', 'Escape', 'Back to the recorded run'),
            ),
            rates=tuple(RATE_LABELS),
            rate=f'{self.clock.rate:g}×',
            timeline=Timeline.reaching(run.time, recorded.end, (*recorded.marks, mark)),
            can_drive=True,
        )

    def _live_plot(self, kind: PlotKind) -> PlotData:
        """Return the last seconds of a plot, and those of the earlier run."""
        run = self.runs[0]
        if kind not in self._tables:  # with a row after the end, which is NaN
            self._tables[kind] = ghost_columns(run.table(kind.columns, run.ticks + 1))
        x, y = run.start
        when, columns = self._history.columns(run.dimensions.ball_radius, (x, -y))
        ticks = np.rint(when / TICK_S).astype(int).clip(max=run.ticks)
        table = {name: each[ticks] for name, each in self._tables[kind].items()}
        return plot_data(kind.with_ghost(), when, {**columns, **table}, keeps_unknown=True)


class _Keeping:
    """Shows on a page how far a recording is."""

    def __init__(self, page: Page, end: float) -> None:
        self._page, self._end = page, end

    def update(self, elapsed_s: float) -> None:
        share = f'{elapsed_s / self._end:.0%}'
        self._page.overlay.show(OverlayState(banner=Banner(f'keeping: {share}', BannerKind.BUSY)))

    def notice(self, text: str) -> None:
        self._page.notify(text)


def _fill(made: Future[ContinuedRun], make: Callable[[], ContinuedRun]) -> None:
    try:
        made.set_result(make())
    except BaseException as error:  # it belongs to who waits for the result
        made.set_exception(error)


def _after(before: Snapshot, tick: Tick, run: ContinuedRun) -> Snapshot:
    """Return the robot at a tick; what has no new sample is as before."""
    truth, inputs, outputs = tick.truth, tick.inputs, tick.outputs
    state = run.program.operating_state
    sonar, sticks = before.sonar, before.sticks
    if inputs.sonar_cm is not None:
        sonar = sonar_cm_to_metres(inputs.sonar_cm)
    if inputs.sticks is not None:
        vertical, horizontal = inputs.sticks
        sticks = -vertical / 100.0, horizontal / 100.0
    forces = [p.force for p in run.pushes if p.start_ns <= truth.stamp_ns < p.end_ns]
    return before._replace(
        time=(truth.stamp_ns - FIRST_TICK_NS) / SECOND_NS,
        position=truth.position,
        psi=truth.psi,
        duty=outputs.duty,
        speed=truth.velocity,
        pitch_rate=truth.psi_rate,
        estimates=(NO_CONTROLLER_STATE if state in OUT_OF_CONTROL else _estimates(run.program)),
        sticks=sticks,
        sonar=sonar,
        battery=truth.battery_voltage,
        state=state.value,
        lcd=outputs.pages[-1] if outputs.pages else before.lcd,
        ball=None,
        force=(sum(x for x, _ in forces), sum(y for _, y in forces)),
    )


def _estimates(program: Program) -> ControllerState:
    def pair(name: str) -> Pair:
        x, y = getattr(program.x, name), getattr(program.y, name)
        return math.radians(x), math.radians(y)

    return ControllerState(*map(pair, ControllerState._fields))


def _tunables(run: ContinuedRun) -> list[Tunable]:
    """Return the numbers that can be changed, as sliders need them."""
    start, now = run.implementation.parameters.values(), run.parameters.values()
    return [
        Tunable.of(
            row.name, row.hint, row.bounds, start[row.name], now[row.name],
            is_whole=isinstance(row.default, int),
        )
        for row in run.implementation.tunable
        if not isinstance(row.default, bool | str)
    ]  # fmt: skip
