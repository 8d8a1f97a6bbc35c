"""Comparison of recorded runs; the first one is the reference."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ballbot_ros.analysis import interactive
from ballbot_ros.analysis.assessment import Assessment
from ballbot_ros.analysis.drawing import draw_rows, draw_tracks
from ballbot_ros.analysis.figure_parts import (
    BLUE,
    GRAY,
    GREEN,
    ORANGE,
    PURPLE,
    SKY,
    DrawnCurve,
    Line,
    Panel,
    Row,
    Table,
    csv_text,
    envelope,
    png_of,
)
from ballbot_ros.analysis.metrics import Verdict, number
from ballbot_ros.analysis.page import number_text, render_template, write_folder
from ballbot_ros.analysis.panels import DUTY, TRUE_PITCH, TRUE_POSITION, motion_columns
from ballbot_ros.analysis.report import MEANINGS, MetricText, banner, metric_text
from ballbot_ros.analysis.run_figures import RenderedFigure, track_table
from ballbot_ros.analysis.run_setup import (
    RecordedSetup,
    SetupChange,
    labels_of,
    names_of,
    setup_changes,
)
from ballbot_ros.errors import BallbotError, similar
from ballbot_ros.parameters import CONTROLLER
from ballbot_ros.recording.messages.topics import GAMEPAD_JOY
from ballbot_ros.robot.world.floor_map import FloorMap, OccupancyGrid

_FORM = re.compile(
    r'\s*(?P<metric>\w+)\s*(?P<sign>[<>])\s*(?P<amount>\d+\.?\d*|\.\d+)\s*(?P<percent>%?)\s*'
)


class ConditionError(BallbotError):
    """A condition that is malformed or names an unknown metric."""


@dataclass(frozen=True)
class Condition:
    """A limit on the change of a metric.

    With the sign ``>``, the metric rose by more than `amount`; with ``<``, it fell by more. The
    amount is in percent of the reference's magnitude, or in the metric's own unit; not negative.
    """

    metric: str
    sign: str
    amount: float
    percent: bool

    def __str__(self) -> str:
        """Return the condition in its input form."""
        return f'{self.metric}{self.sign}{self.amount:.12g}{"%" if self.percent else ""}'

    def holds(self, reference: float, value: float) -> bool:
        """Return whether `value` has changed by more than the limit from `reference`.

        If only `value` is missing (NaN), the metric counts as worse: the condition holds. If the
        reference is missing, it does not hold. A change from a reference of 0 exceeds any
        percentage.
        """
        if math.isnan(reference):
            return False
        if math.isnan(value):
            return True
        rise = value - reference if self.sign == '>' else reference - value
        return rise > (abs(reference) * self.amount / 100.0 if self.percent else self.amount)


def parse_condition(text: str, metrics: Iterable[str]) -> Condition:
    """Parse a condition.

    It raises ConditionError if `text` is not of the form ``metric>5%`` or ``metric<0.1``, or its
    metric is not one of the `metrics`.
    """
    match = _FORM.fullmatch(text)
    if not match:
        raise ConditionError(
            f'--fail-if {text!r}: not of the form metric>5%, metric>0.1, metric<5% or metric<0.1'
        )
    known = list(metrics)
    name = match['metric']
    if name not in known:
        found = similar(name, known)
        hint = f'did you mean {found}?' if found else f'known: {", ".join(known)}'
        raise ConditionError(f'--fail-if {text!r}: unknown metric {name!r}; {hint}')
    return Condition(name, match['sign'], float(match['amount']), bool(match['percent']))


_COLOURS = (BLUE, ORANGE, GREEN, PURPLE, SKY, GRAY)
_LEFT_OUT = 'A plane in which all runs stay at zero is left out.'

_DASHES = ('-', '--', '-.', ':')

NOTHING_CHANGED = 'Nothing was changed: parameters, scenario, seed and versions are the same.'


_COMPARED: Mapping[str, Panel] = {'pitch': TRUE_PITCH, 'position': TRUE_POSITION, 'duty': DUTY}
"""The compared quantities by the names of their figures."""


@dataclass(frozen=True)
class ComparedRun:
    """The data of a run that a comparison needs, without ticks, so that many runs fit in memory.

    Attributes
    ----------
    letter : str
        ``A`` for the reference, ``B`` and so on.
    controller : str
        Name of its controller; '' if unknown.
    trusted : bool
        Whether the run is complete and did not fail.
    motion, track : Table
        The numbers of the figures; of a real robot, as estimated.
    first_stick, calibrated : float
        Time of the first stick that is not neutral, or NaN, and of the end of the calibration [s].
    """

    letter: str
    path: Path
    outcome: str
    reason: str
    controller: str
    trusted: bool
    metrics: dict[str, float]
    motion: Table
    track: Table
    floor: FloorMap | OccupancyGrid | None
    notes: tuple[str, ...]
    setup: RecordedSetup
    duty_sha256: str | None
    is_real: bool
    first_stick: float
    calibrated: float

    @classmethod
    def from_assessment(cls, letter: str, assessment: Assessment) -> ComparedRun:
        """Return the data of a run that a comparison needs."""
        run = assessment.run
        sticks = run.series.get(GAMEPAD_JOY)
        is_moved = sticks is not None and np.nan_to_num(sticks.values).any(axis=1)
        return cls(
            letter=letter,
            path=run.path,
            outcome=assessment.outcome,
            reason=assessment.reason,
            controller=run.attached.controller,
            trusted=run.complete and assessment.outcome is not Verdict.FAILED,
            metrics=assessment.metrics,
            motion=envelope(run.motion.time, motion_columns(run.motion)),
            track=track_table(run),
            floor=run.floor,
            notes=tuple(banner(run)),
            setup=RecordedSetup.of(run),
            duty_sha256=run.duty_sha256,
            is_real=run.is_real,
            first_stick=sticks.time[is_moved][0] if sticks and np.any(is_moved) else math.nan,
            calibrated=run.calibrated,
        )

    def aligned(self, seconds: float) -> ComparedRun:
        """Return the run on another clock, with positions from its start, so without a map."""

        def moved(table: Table) -> Table:
            firsts = {n: each[:1] for n, each in table.items() if n.startswith(('position', 'map'))}
            firsts['time_s'] = np.array([-seconds])
            return {n: each - firsts.get(n, 0.0) for n, each in table.items()}

        return replace(self, motion=moved(self.motion), track=moved(self.track), floor=None)


@dataclass(frozen=True)
class Comparison:
    """Runs to compare; the first one is the reference.

    Attributes
    ----------
    labels : list of str
        For each run: letter, name and what was changed.
    alignment : str
        Where the times of real and simulated runs are aligned; '' if none is real.
    """

    runs: Sequence[ComparedRun]
    changes: list[SetupChange]
    labels: list[str]
    alignment: str = ''

    @classmethod
    def of(cls, runs: Sequence[ComparedRun]) -> Comparison:
        """Return the comparison of runs."""
        changes = setup_changes([each.setup for each in runs])
        names = names_of([each.path for each in runs])
        if not any(each.is_real for each in runs):
            return cls(runs, changes, labels_of(names, changes))
        names = [
            f'{name}, {"real robot (estimated)" if each.is_real else "simulated"}'
            for name, each in zip(names, runs, strict=True)
        ]
        times, event = [each.first_stick for each in runs], 'the first stick'
        if any(map(math.isnan, times)):
            times, event = [each.calibrated for each in runs], 'the end of the calibration'
        shown = [each.aligned(max(times) - time) for each, time in zip(runs, times, strict=True)]
        # A real robot has no other parameters, and its file was made on another occasion.
        changes = [each for each in changes if each.name.startswith(f'{CONTROLLER}.')]
        labels, at = labels_of(names, []), f'{max(times):.3f} s'
        return cls(shown, changes, labels, f'aligned at {event}, at {at}')

    @property
    def apart(self) -> list[str]:
        """How far the motion of each later run is from the first one, if known and aligned."""
        later = self.runs[1:] if self.alignment else ()
        return [told for each in later if (told := _apart(self.runs[0], each))]

    @property
    def change_rows(self) -> list[tuple[str, str]]:
        """Name and values of each change as text."""
        letters = [each.letter for each in self.runs]
        return [(each.name, each.text(letters)) for each in self.changes]

    @property
    def identical(self) -> str:
        """Which runs have the duties of the first; '' if there is none."""
        first = self.runs[0].duty_sha256
        same = [each.letter for each in self.runs[1:] if first and each.duty_sha256 == first]
        return f'identical duties: {self.runs[0].letter}, {", ".join(same)}' if same else ''


def _apart(first: ComparedRun, other: ComparedRun) -> str:
    told = []
    mine, its = first.motion, other.motion
    time, known = mine['time_s'], its['time_s']
    both = (time >= known.min(initial=np.inf)) & (time <= known.max(initial=-np.inf))
    for panel in (TRUE_PITCH, TRUE_POSITION) if both.any() else ():
        gaps = [
            panel.scale * (np.interp(time[both], known, its[each.column]) - mine[each.column][both])
            for each in panel.curves
        ]
        rms, peak = np.sqrt(np.mean(np.square(gaps))), np.max(np.abs(gaps))
        if not np.isnan(rms):
            told.append(
                f'{panel.quantity} {number_text(rms)} {panel.unit} rms, '
                f'{number_text(peak)} {panel.unit} peak'
            )
    return f'{other.letter} − {first.letter} at the same time: {"; ".join(told)}' if told else ''


def failures(comparison: Comparison, conditions: Iterable[Condition]) -> list[str]:
    """Return the runs that cannot be trusted and the conditions that hold, as text."""
    runs, conditions = comparison.runs, list(conditions)
    if not conditions:
        return []
    found = [
        f'{label} is {each.outcome} ({each.reason}): its metrics prove nothing'
        for label, each in zip(comparison.labels, runs, strict=True)
        if not each.trusted
    ]
    reference = runs[0]
    for condition in conditions:
        before = reference.metrics[condition.metric]
        for each in runs[1:]:
            value = each.metrics[condition.metric]
            if condition.holds(before, value):
                found.append(
                    f'{condition}: {reference.letter} {number_text(before)}, '
                    f'{each.letter} {number_text(value)}'
                )
    return found


def _absolute_and_relative_change(reference: float, value: float) -> tuple[float, float]:
    """Return the change, and the change in percent of the reference's magnitude; NaN if unknown."""
    change = value - reference
    if change == 0.0:
        return 0.0, 0.0
    return change, change / abs(reference) * 100.0 if reference else math.nan


def as_json(comparison: Comparison, failed: Sequence[str]) -> dict[str, object]:
    """Return the comparison as one object; missing numbers are None."""
    runs = comparison.runs
    reference = runs[0]
    metrics: dict[str, object] = {}
    for name in MEANINGS:
        before = reference.metrics[name]
        differences = [
            _absolute_and_relative_change(before, each.metrics[name]) for each in runs[1:]
        ]
        metrics[name] = {
            'values': [number(each.metrics[name]) for each in runs],
            'changes': [number(change) for change, _ in differences],
            'changes_percent': [number(percent) for _, percent in differences],
        }
    return {
        'changes': [{'name': each.name, 'values': each.values} for each in comparison.changes],
        'alignment': comparison.alignment or None,
        'apart': comparison.apart,
        'runs': [
            {
                'label': label,
                'recording': str(each.path),
                'duty_sha256': each.duty_sha256,
                'outcome': each.outcome,
                'reason': each.reason,
                'controller': each.controller or None,
                'notes': list(each.notes),
            }
            for label, each in zip(comparison.labels, runs, strict=True)
        ],
        'metrics': metrics,
        'failures': list(failed),
    }


class Change(NamedTuple):
    """A metric of a later run as text, and its change from the first run."""

    value: str
    change: str
    percent: str


class MetricComparison(NamedTuple):
    """A metric as text, for the first run and each later one."""

    text: MetricText
    changes: list[Change]
    is_same: bool


def metric_comparisons(runs: Sequence[ComparedRun]) -> list[MetricComparison]:
    """Return the metrics that at least one run has, or with a real robot all runs."""
    content = []
    lacks = any if any(each.is_real for each in runs) else all
    for name in MEANINGS:
        values = [each.metrics[name] for each in runs]
        if lacks(map(math.isnan, values)) or (name.startswith('time_in_') and not any(values)):
            continue
        later = []
        for value in values[1:]:
            change, percent = _absolute_and_relative_change(values[0], value)
            share = f'{_signed(percent)} %' if not math.isnan(percent) else '–'
            later.append(Change(metric_text(name, value).value, _signed(change), share))
        is_same = all(np.array_equal(v, values[0], equal_nan=True) for v in values)
        content.append(MetricComparison(metric_text(name, values[0]), later, is_same))
    return content


def _signed(value: float) -> str:
    return f'+{number_text(value)}' if value > 0.0 else number_text(value)


def write_comparison(comparison: Comparison, failed: Sequence[str], folder: Path) -> None:
    """Write page, figures and metrics of the comparison, as `page.write_folder` does."""
    runs = comparison.runs
    figures = list(_figures(comparison))
    rows = metric_comparisons(runs)
    page = render_template(
        'compare.html',
        title='Comparison of ' + ', '.join(comparison.labels),
        comparison=comparison,
        nothing_changed=NOTHING_CHANGED,
        runs=runs,
        different=[row for row in rows if not row.is_same],
        same=[row for row in rows if row.is_same],
        failed=failed,
        figures=figures,
        interactive=_interactive(comparison),
        left_out=_LEFT_OUT,
        missing=interactive.MISSING,
    )
    metrics = csv_text(
        ('metric', *(each.letter for each in runs)),
        (
            (name, *('' if math.isnan(v) else repr(v) for v in (r.metrics[name] for r in runs)))
            for name in MEANINGS
        ),
    )
    write_folder(folder, page, figures, {'metrics.csv': metrics})


def _figures(comparison: Comparison) -> Iterable[RenderedFigure]:
    for name, panel in _COMPARED.items():
        if rows := _rows(comparison, panel):
            title = panel.quantity.capitalize()
            caption = f'{title} of all runs against time. {_LEFT_OUT}'
            yield RenderedFigure(name, title, caption, png_of(draw_rows(rows)), {})
    if tracks := _tracks(comparison):
        caption = 'The tracks of the ball from above; a dot marks the start, a square the end.'
        png = png_of(draw_tracks(tracks, comparison.runs[0].floor))
        yield RenderedFigure('track', 'Track', caption, png, {})


def _interactive(comparison: Comparison) -> interactive.InteractiveFigures | None:
    rows = [row for panel in _COMPARED.values() for row in _rows(comparison, panel)]
    if not rows:
        return None

    def make(numbers: interactive.PackedNumbers) -> dict[str, interactive.Json]:
        end = max(float(each.time[-1]) for row in rows for each in row.curves)
        figures = {'history': interactive.history_figure(rows, interactive.Events(end), numbers)}
        if tracks := _tracks(comparison):
            floor = comparison.runs[0].floor
            figures['path'] = interactive.track_figure(tracks, floor, (), numbers)
        return figures

    return interactive.packed_figures(make, (*_COMPARED, 'track'))


def _rows(comparison: Comparison, panel: Panel) -> list[Row]:
    """Return a row for each plane in which the quantity of a run is not always zero."""
    rows, lines = [], _lines(comparison)
    for each in map(panel.of_plane, 'xy'):
        (curve,) = each.curves
        curves = tuple(
            DrawnCurve(
                run.motion['time_s'], values * each.scale, line, f'{each.quantity}, {line.label}'
            )
            for run, line in zip(comparison.runs, lines, strict=True)
            if not np.isnan(values := run.motion[curve.column]).all()
        )
        if any(each.values.any() for each in curves):
            rows.append(Row(each, curves))
    return rows


def _tracks(comparison: Comparison) -> list[tuple[Table, Line]]:
    """Return the tracks that are known, with their lines."""
    runs = zip(comparison.runs, _lines(comparison), strict=True)
    return [(run.track, line) for run, line in runs if not np.isnan(run.track['map_x_cm']).all()]


def _lines(comparison: Comparison) -> list[Line]:
    """Return the line of each run."""
    # The first line is the widest, so that later ones do not hide it.
    return [
        Line(
            _COLOURS[index % len(_COLOURS)],
            2.0 if index == 0 else 1.1,
            _DASHES[index % len(_DASHES)],
            label,
        )
        for index, label in enumerate(comparison.labels)
    ]
