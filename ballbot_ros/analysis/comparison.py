"""Comparison of recorded runs; the first one is the reference."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from ballbot_ros.analysis.assessment import Assessment
from ballbot_ros.analysis.conditions import Condition
from ballbot_ros.analysis.drawing import (
    DUTY,
    PITCH,
    POSITION,
    Quantity,
    draw_floor,
    draw_line,
    draw_track,
    frame_curves,
    label_time,
    legend_above,
)
from ballbot_ros.analysis.figure_tables import duty_table, pitch_table, position_table, track_table
from ballbot_ros.analysis.metrics import number
from ballbot_ros.analysis.page import number_text, render_template, write_folder
from ballbot_ros.analysis.report import MEANINGS, MetricText, banner, metric_text
from ballbot_ros.analysis.run_data import RunData
from ballbot_ros.analysis.run_figures import RenderedFigure
from ballbot_ros.analysis.style import (
    BLUE,
    GRAY,
    GREEN,
    ORANGE,
    PURPLE,
    SKY,
    WIDTH,
    Line,
    new_figure,
    png_of,
)
from ballbot_ros.analysis.table import Table, csv_text
from ballbot_ros.analysis.verdict import Verdict
from ballbot_ros.former_names import FORMER_METRICS, with_former_names
from ballbot_ros.messages.topics import MOTOR_DUTY, PLANT_IMU, PLANT_ODOM, Topic
from ballbot_ros.world.exports import OccupancyGrid
from ballbot_ros.world.floor_map import FloorMap

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_COLOURS = (BLUE, ORANGE, GREEN, PURPLE, SKY, GRAY)
_DASHES = ('-', '--', '-.', ':')


@dataclass(frozen=True)
class _Source:
    """A compared quantity and its source."""

    quantity: Quantity
    title: str
    topic: Topic
    table: Callable[[RunData], Table]


_SOURCES = (
    _Source(PITCH, 'Body pitch', PLANT_IMU, pitch_table),
    _Source(POSITION, 'Position', PLANT_ODOM, position_table),
    _Source(DUTY, 'Duty', MOTOR_DUTY, duty_table),
)


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
    tables : dict of str to Table
        The numbers of each figure, by the figure's name.
    """

    letter: str
    path: Path
    outcome: str
    reason: str
    controller: str
    trusted: bool
    metrics: dict[str, float]
    tables: dict[str, Table]
    floor: FloorMap | OccupancyGrid | None
    notes: tuple[str, ...]

    @classmethod
    def from_assessment(cls, letter: str, assessment: Assessment) -> ComparedRun:
        """Return the data of a run that a comparison needs."""
        run = assessment.run
        tables = {s.quantity.name: s.table(run) for s in _SOURCES if s.topic in run.series}
        if PLANT_ODOM in run.series:
            tables['track'] = track_table(run)
        return cls(
            letter=letter,
            path=run.path,
            outcome=assessment.outcome,
            reason=assessment.reason,
            controller=run.attached.controller,
            trusted=run.complete and assessment.outcome is not Verdict.FAILED,
            metrics=assessment.metrics,
            tables=tables,
            floor=run.floor,
            notes=tuple(banner(run)),
        )

    @property
    def label(self) -> str:
        """Letter and name."""
        return f'{self.letter} {self.path.stem}'


def failures(runs: Sequence[ComparedRun], conditions: Iterable[Condition]) -> list[str]:
    """Return the runs that cannot be trusted and the conditions that hold, as text."""
    conditions = list(conditions)
    if not conditions:
        return []
    found = [
        f'{each.label} is {each.outcome} ({each.reason}): its metrics prove nothing'
        for each in runs
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


def absolute_and_relative_change(reference: float, value: float) -> tuple[float, float]:
    """Return the change, and the change in percent of the reference's magnitude; NaN if unknown."""
    change = value - reference
    if change == 0.0:
        return 0.0, 0.0
    return change, change / abs(reference) * 100.0 if reference else math.nan


def as_json(runs: Sequence[ComparedRun], failed: Sequence[str]) -> dict[str, object]:
    """Return the comparison as one object; missing numbers are None."""
    reference = runs[0]
    metrics: dict[str, object] = {}
    for name in MEANINGS:
        before = reference.metrics[name]
        differences = [
            absolute_and_relative_change(before, each.metrics[name]) for each in runs[1:]
        ]
        metrics[name] = {
            'values': [number(each.metrics[name]) for each in runs],
            'changes': [number(change) for change, _ in differences],
            'changes_percent': [number(percent) for _, percent in differences],
        }
    return {
        'runs': [
            {
                'recording': str(each.path),
                'outcome': each.outcome,
                'reason': each.reason,
                'controller': each.controller or None,
                'notes': list(each.notes),
            }
            for each in runs
        ],
        'metrics': with_former_names(metrics, FORMER_METRICS),
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


def metric_comparisons(runs: Sequence[ComparedRun]) -> list[MetricComparison]:
    """Return the metrics that at least one run has."""
    content = []
    for name in MEANINGS:
        values = [each.metrics[name] for each in runs]
        nothing = all(math.isnan(value) for value in values)
        if nothing or (name.startswith('time_in_') and not any(values)):
            continue
        later = []
        for value in values[1:]:
            change, percent = absolute_and_relative_change(values[0], value)
            share = f'{_signed(percent)} %' if not math.isnan(percent) else '–'
            later.append(Change(metric_text(name, value).value, _signed(change), share))
        content.append(MetricComparison(metric_text(name, values[0]), later))
    return content


def _signed(value: float) -> str:
    return f'+{number_text(value)}' if value > 0.0 else number_text(value)


def write_comparison(runs: Sequence[ComparedRun], failed: Sequence[str], folder: Path) -> None:
    """Write page, figures and metrics of the comparison, as `page.write_folder` does."""
    figures = list(_figures(runs))
    page = render_template(
        'compare.html',
        title='Comparison of ' + ', '.join(each.label for each in runs),
        runs=runs,
        rows=metric_comparisons(runs),
        failed=failed,
        figures=figures,
    )
    metrics = csv_text(
        ('metric', *(each.letter for each in runs)),
        (
            (name, *('' if math.isnan(v) else repr(v) for v in (r.metrics[name] for r in runs)))
            for name in MEANINGS
        ),
    )
    write_folder(folder, page, figures, {'metrics.csv': metrics})


def _figures(runs: Sequence[ComparedRun]) -> Iterable[RenderedFigure]:
    for source in _SOURCES:
        name, title = source.quantity.name, source.title
        if any(name in each.tables for each in runs):
            yield RenderedFigure(
                name,
                title,
                f'{title} of all runs against time, plane x above and plane y below.',
                png_of(_draw_quantity(source.quantity, runs)),
                {},
            )
    if any('track' in each.tables for each in runs):
        yield RenderedFigure(
            'track',
            'Track',
            'The tracks of the ball from above; a dot marks the start, a square the end.',
            png_of(_draw_tracks(runs)),
            {},
        )


def _lines(runs: Sequence[ComparedRun], name: str) -> Iterator[tuple[Table, Line]]:
    """Iterate over the runs' tables of this name, with the line style of each."""
    for index, each in enumerate(runs):
        if name in each.tables:
            # The first line is the widest, so that later ones do not hide it.
            yield (
                each.tables[name],
                Line(
                    _COLOURS[index % len(_COLOURS)],
                    2.0 if index == 0 else 1.1,
                    _DASHES[index % len(_DASHES)],
                    each.label,
                ),
            )


def _draw_quantity(quantity: Quantity, runs: Sequence[ComparedRun]) -> Figure:
    figure = new_figure(WIDTH, 5.0)
    both = figure.subplots(2, 1, sharex=True)
    for axes, plane in zip(both, 'xy', strict=True):
        for table, line in _lines(runs, quantity.name):
            draw_line(axes, table['time_s'], table[quantity.column(plane)], line)
        frame_curves(axes, f'{quantity.label}, {plane}')
    legend_above(both[0], 3)
    label_time(both[1])
    return figure


def _draw_tracks(runs: Sequence[ComparedRun]) -> Figure:
    figure = new_figure(WIDTH, 5.0)
    axes = figure.subplots()
    draw_floor(axes, runs[0].floor)
    for table, line in _lines(runs, 'track'):
        draw_track(axes, table, line)
    legend_above(axes, 3)
    return figure
