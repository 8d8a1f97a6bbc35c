"""What a live page tells about the run: its activity, its report, the session around it."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from html import escape
from pathlib import Path
from threading import Lock
from typing import Any

from ballbot_ros.analysis.metrics import Judgement, Verdict
from ballbot_ros.engine.scenario.metrics import label
from ballbot_ros.engine.scenario.scenario import Expectation
from ballbot_ros.errors import BallbotError
from ballbot_ros.lockstep.run_actions import Outcome
from ballbot_ros.recording.messages.run_reports import PlantReport
from ballbot_ros.robot.plant.ground_truth import Pair
from ballbot_ros.viewer.overlay import Banner, BannerKind, Button, OverlayState, Timeline
from ballbot_ros.viewer.snapshot import Snapshot


@dataclass(frozen=True)
class Session:
    """The run that the command has started last.

    Attributes
    ----------
    result : Banner or None
        What it says about its result; None until it has ended.
    recording : str
        Path of its recording; '' until it has ended, or if there is none.
    """

    scenario: str
    result: Banner | None = None
    recording: str = ''


def encode_session(scenario: str, result: Mapping[str, object] | None = None) -> str:
    """Return a session as JSON; `result` is the object that ``run --json`` prints."""
    return json.dumps({'scenario': scenario, 'result': result}, allow_nan=False)


def decode_session(text: str) -> Session:
    """Decode a session; ValueError if the text is none."""
    try:
        content = json.loads(text)
        scenario, result = str(content['scenario']), content['result']
        if result is None:
            return Session(scenario)
        recording = str(result.get('recording') or '')
        return Session(scenario, _result_banner(scenario, result, recording), recording)
    except (AttributeError, KeyError, RecursionError, TypeError) as error:
        raise ValueError(f'not a session: {error!r}') from None


def _missed_property(content: Mapping[str, Any]) -> str:
    """Return the name of a property, and the moment that decides it."""
    moment = content['moment_s']
    return str(content['name']) + ('' if moment is None else f': missed at {moment:.2f} s')


def _judgement(content: Mapping[str, Any]) -> Judgement:
    """Return what :meth:`Judgement.as_json` has written, where a missing number is None."""
    end, value = content['to'], content['value']
    expectation = Expectation(
        content['metric'],
        start=content['from'],
        end=math.inf if end is None else end,
        minimum=content['min'],
        maximum=content['max'],
    )
    return Judgement(expectation, math.nan if value is None else value)


SPAN_S = 1.0
"""Wall time over which the factor is measured."""


class RealTimeFactor:
    """Sim time per wall time, over the last :data:`SPAN_S` of wall time."""

    def __init__(self) -> None:
        self._ticks: list[tuple[float, float]] = []

    def update(self, now_s: float, sim_time: float) -> float:
        """Return the factor at `now_s` on a monotonic clock [s]; 0 without an earlier sample."""
        if self._ticks and sim_time < self._ticks[-1][1]:
            self._ticks.clear()  # another run, or a player that has jumped back
        self._ticks.append((now_s, sim_time))
        while now_s - self._ticks[0][0] > SPAN_S:
            self._ticks.pop(0)
        wall, sim = self._ticks[0]
        return (sim_time - sim) / (now_s - wall) if now_s > wall else 0.0


_UNKNOWN = '–'


def drive_status(snapshot: Snapshot | None, factor: float) -> Mapping[str, str]:
    """Return names and texts; None before the robot's first pose.

    Forward and rightward are positive. `factor` is sim time per wall time.
    """
    if snapshot is None:
        names = ('sim time', 'state', 'position', 'pitch', 'speed', 'sonar')
        return dict.fromkeys(names, _UNKNOWN)
    return {
        'sim time': f'{snapshot.time:.1f} s   {factor:.2f} × real time',
        'state': snapshot.state + '   press r to restart' * snapshot.is_out_of_control,
        'position': _pair(snapshot.position, 100.0, 'cm'),
        'pitch': _pair(snapshot.psi, math.degrees(1.0), '°'),
        'speed': _pair(snapshot.speed, 100.0, 'cm/s'),
        'sonar': _distance(snapshot.sonar),
    }


def _pair(values: Pair, scale: float, unit: str) -> str:
    forward, rightward = (f'{value * scale:+7.1f} {unit:<4}' for value in values)
    return f'forward {forward}   rightward {rightward}'.rstrip()


def _distance(metres: float) -> str:
    if math.isnan(metres):
        return _UNKNOWN
    return f'{metres * 100.0:.0f} cm' if math.isfinite(metres) else 'no echo'


PAUSE, STEP, RESET, BACK = 'pause', 'step', 'reset', 'back'
BACK_S = 5.0
"""The part of a run that is taken back."""

RATES = {'0.1×': 0.1, '0.25×': 0.25, '0.5×': 0.5, '1×': 1.0, '2×': 2.0, 'max': 0.0}
"""Real-time factors by their labels; 0 is as fast as possible."""

REPORT = '/report'
_MAX_DETAILS = 4

_KINDS: Mapping[str, BannerKind] = {
    Verdict.PASSED: BannerKind.GOOD,
    Verdict.CHANGED: BannerKind.INFO,
    Verdict.STOPPED: BannerKind.INFO,
    Outcome.COMPLETED: BannerKind.GOOD,
}
"""The kinds of the good ends; all others are bad."""


@dataclass(frozen=True)
class RunActivity:
    """What is known about the run that a page shows.

    Attributes
    ----------
    session : Session or None
        What the command of the run tells; None without such a command.
    has_pose : bool
        Whether the robot's pose in this run is known.
    report : PlantReport or None
        The plant's newest report about that run.
    has_lost_plant : bool
        Whether there was a plant, and is none.
    is_out_of_control : bool
        Whether the controller has given up, as after a fall.
    time : float
        Sim time [s].
    """

    session: Session | None = None
    has_pose: bool = False
    report: PlantReport | None = None
    has_lost_plant: bool = False
    is_out_of_control: bool = False
    time: float = 0.0

    @property
    def is_controllable(self) -> bool:
        """Whether the run can be paused, paced and driven."""
        return not self.has_lost_plant and self.report is not None and not self.report.outcome

    @property
    def is_paused(self) -> bool:
        """Whether the run is paused."""
        return self.report is not None and self.report.is_paused

    @property
    def awaits_start(self) -> bool:
        """Whether the run waits until somebody looks."""
        return self.report is not None and self.report.awaits_start

    @property
    def overlay(self) -> OverlayState:
        """What the overlay shows."""
        if not self.is_controllable:
            return OverlayState(banner=self._banner)
        assert self.report is not None
        back = Button(
            BACK, f'Back {BACK_S:g} s', 'b', 'End the run, and go on from an earlier time'
        )
        return OverlayState(
            banner=self._banner,
            buttons=(
                Button(PAUSE, 'Pause', ' ', 'Pause, or resume', is_pressed=self.is_paused),
                Button(STEP, 'Step', '.', 'Run one tick of a paused plant'),
                Button(RESET, 'Reset', 'r', 'Begin a new run'),
                *([back] if self.session else []),
            ),
            rates=tuple(RATES),
            rate=next((name for name, pace in RATES.items() if pace == self.report.pace), ''),
            timeline=Timeline.reaching(self.time) if self.session else None,
            can_drive=True,
        )

    @property
    def _banner(self) -> Banner | None:
        session, report = self.session, self.report
        if session and session.result:
            return session.result
        if session and report and report.outcome:
            return Banner(f'{session.scenario} has ended, judging …', BannerKind.BUSY)
        if report and report.outcome:
            kind = _KINDS.get(report.outcome, BannerKind.BAD)
            return Banner(f'run {report.outcome}', kind, _lines(report.problem))
        if report and report.missing:
            return Banner(f'waiting for {", ".join(report.missing)} …', BannerKind.BUSY)
        if not self.has_pose:
            what = f'starting {session.scenario}' if session else 'waiting for a run'
            return Banner(f'{what} …', BannerKind.BUSY)
        if self.has_lost_plant:
            return Banner('the plant has ended', BannerKind.BAD)
        if report and (banner := _report_banner(report)):
            return banner
        if not self.is_out_of_control:
            return None
        hint = 'Reset, or r, begins a new run' if self.is_controllable else ''
        return Banner('out of control, the motors are off', BannerKind.BAD, _lines(hint))


def _lines(text: str) -> tuple[str, ...]:
    return (text,) if text else ()


def _report_banner(report: PlantReport) -> Banner | None:
    """Return the banner of a run that has begun; None if it just runs."""
    if report.awaits_start:
        return Banner('the run is about to begin', BannerKind.BUSY)
    if report.is_paused:
        return Banner('paused', BannerKind.INFO, ('Space resumes, . runs one tick',))
    return Banner(report.problem, BannerKind.BAD) if report.problem else None


def _result_banner(scenario: str, result: Mapping[str, Any], recording: str) -> Banner:
    verdict = str(result['outcome'])
    return Banner(
        f'{scenario}: {verdict}',
        _KINDS.get(verdict, BannerKind.BAD),
        _result_details(result),
        link=REPORT if recording else '',
        link_text='report',
    )


def _result_details(result: Mapping[str, Any]) -> tuple[str, ...]:
    """Return what was not met, or else the reason of a failure and a few metrics."""
    expectations, properties = result.get('expectations', ()), result.get('properties', ())
    judgements = [_judgement(each) for each in expectations if each['holds'] is not None]
    missed = [_missed_text(each) for each in judgements if not each.holds]
    missed += [_missed_property(each) for each in properties if each['holds'] is False]
    if missed:
        rest = len(missed) - _MAX_DETAILS
        return (*missed[:_MAX_DETAILS], *([f'and {rest} more'] if rest > 0 else []))
    whole = [each for each in judgements if each.expectation.covers_whole_run]
    return (*_lines(str(result['reason'])), *map(_value_text, whole[:_MAX_DETAILS]))


def _missed_text(judgement: Judgement) -> str:
    expectation = judgement.expectation
    window = f', {expectation.window}' if expectation.window else ''
    return f'{_value_text(judgement)}{window}: expected {expectation}'


def _value_text(judgement: Judgement) -> str:
    name, unit = label(judgement.expectation.metric)
    value = '–' if math.isnan(judgement.value) else f'{judgement.value:.3f} {unit}'
    return f'{name} {value}'.rstrip()


_MAKING = Lock()


def report_of(recording: str) -> bytes:
    """Return the report of a recording, or a page that says why there is none.

    It is made when it is first asked for; any thread may ask.
    """
    with _MAKING:
        return _report(recording)


@lru_cache(1)
def _report(recording: str) -> bytes:
    if not recording:
        return _notice('This run has no report: it has not ended, or was not recorded.')
    # Imported only here: it takes half a second.
    from ballbot_ros.analysis.assessment import assess
    from ballbot_ros.analysis.report import report_document
    from ballbot_ros.analysis.run_data import read_run

    try:
        return report_document(assess(read_run(Path(recording)))).encode()
    except (BallbotError, OSError) as error:
        return _notice(f'There is no report: {error}')


def _notice(text: str) -> bytes:
    return f'<!DOCTYPE html><title>Report</title><p>{escape(text)}</p>'.encode()
