"""The report of a study: a page, its figures and its numbers."""

from __future__ import annotations

import os
import re
import shutil
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations, islice
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from ballbot_ros.analysis.chart import ChartFigure
from ballbot_ros.analysis.figure_parts import Table, csv_of, png_of
from ballbot_ros.analysis.interactive import MISSING, InteractiveFigures, packed_figures
from ballbot_ros.analysis.page import (
    ReportError,
    check_folder,
    number_text,
    render_template,
    write_folder,
)
from ballbot_ros.analysis.run_figures import RenderedFigure
from ballbot_ros.engine.scenario.scenario import bounds_text
from ballbot_ros.errors import BallbotError, StudyError, one_line, os_errors
from ballbot_ros.files import own_command
from ballbot_ros.lab.studies.charts import (
    Histogram,
    ShareChart,
    histogram_edges,
    sensitivity_figure,
    sensitivity_table,
    share_bins,
)
from ballbot_ros.lab.studies.columns import PASSED, ResultColumn
from ballbot_ros.lab.studies.events import is_event
from ballbot_ros.lab.studies.manifest import StudyRecord
from ballbot_ros.lab.studies.maps import PassMap, PredictedLimit, map_bins, predict, usual_values
from ballbot_ros.lab.studies.outcomes import ending_table, endings_below, endings_of
from ballbot_ros.lab.studies.programs import with_values
from ballbot_ros.lab.studies.rerun import study_parameters
from ballbot_ros.lab.studies.sensitivity import MAX_SAMPLE, MIN_SAMPLE, SLICES, analyse
from ballbot_ros.lab.studies.study import GAINS, StudyText
from ballbot_ros.lab.studies.study_data import QUANTILES, RunResults, StudyData, StudySummary
from ballbot_ros.lab.studies.survey import Axis, Survey, tally

REPORT = 'report'
"""Name of the report's folder in that of its study."""

_SUFFIXES = {'.html', '.png', '.csv'}


@dataclass(frozen=True)
class StudyReport:
    """A report, ready to be written: the HTML, pictures, and other files by name."""

    page: str
    figures: Sequence[RenderedFigure]
    files: Mapping[str, bytes]

    def write(self, folder: Path) -> None:
        """Write it into a folder, which is new, empty, or has an earlier report of a study.

        It raises ReportError if the folder can't be written.
        """
        if _is_report(folder):
            with os_errors(ReportError, folder):
                shutil.rmtree(folder)
        write_folder(folder, self.page, self.figures, self.files)


def check_output(study: Path, output: Path | None) -> Path:
    """Return the folder of the report of a study, by default in the folder of the study.

    It raises ReportError if it has files that are not those of an earlier report, or can't be
    written.
    """
    folder = output or study / REPORT
    if not _is_report(folder):
        check_folder(folder)
    existing = next(each for each in (folder, *folder.absolute().parents) if each.exists())
    if not existing.is_dir():
        raise ReportError(f'{existing}: not a folder; choose another --output')
    if not os.access(existing, os.W_OK | os.X_OK):
        raise ReportError(f'{existing}: Permission denied; choose another --output')
    return folder


def _is_report(folder: Path) -> bool:
    """Return whether a folder has a page, and nothing but the files of a report."""
    if not (folder / 'index.html').is_file():
        return False
    return all(each.is_file() and each.suffix in _SUFFIXES for each in folder.iterdir())


FAILED_SHOWN = 10

MAPPED_VARIABLES = 4
"""Largest number of variables, those with the most influence, of which all pairs have a map."""


def study_report(data: StudyData) -> StudyReport:
    """Make the report of a study, finished or not.

    Rows are read part by part; the memory is that of one number a run. Sensitivities are those of
    at most :data:`~ballbot_ros.lab.studies.sensitivity.MAX_SAMPLE` runs, drawn by the study's seed.
    It raises BallbotError if there are no runs yet, a part is damaged, or SALib is not installed.
    """
    return _Findings(data).report()


class _Findings:
    """All that is read and computed for a report."""

    def __init__(self, data: StudyData) -> None:
        study = data.study
        self.data = data
        self.text = StudyText.of(study.text)
        designed = GAINS if self.text.redesign else ()
        self.varied = [each for each in study.varied if each.name not in designed]
        survey = self.survey = Survey.of(data, MAX_SAMPLE, np.random.default_rng(study.seed))
        if not survey.totals.runs:
            raise StudyError(f'{data.path}: has no results yet')
        varied = {each.name: survey.sample[each.name] for each in self.varied}
        results = {each.name: survey.sample[each.name] for each in (*study.measures, PASSED)}
        self.found = analyse(varied, results, study.seed)
        self.summary = data.summary()
        self.axes = [self._axis(each, share_bins) for each in self.varied]
        self.pairs = self._pairs()
        self.edges = {
            each.name: histogram_edges(each, survey.extents[each.name], survey.sample[each.name])
            for each in study.measures
        }
        self.tallies = tally(data, self.pairs, self.axes, self.edges)

    def _pairs(self) -> list[tuple[Axis, Axis]]:
        """Return the axes of each map, horizontal and vertical, the most influential pair first."""
        names = self.found.most_influential(MAPPED_VARIABLES)
        # In the order of the study, so that a variable is on the same side of all its maps.
        varied = [each for each in self.varied if each.name in names]
        axes = {each.name: self._axis(each, map_bins) for each in varied}
        ranks = list(axes)
        chosen = (sorted(pair, key=ranks.index) for pair in combinations(names, 2))
        return [(axes[x], axes[y]) for x, y in chosen]

    def _axis(self, column: ResultColumn, bins: Callable[[int], int]) -> Axis:
        runs = self.survey.totals.runs
        return Axis.of(
            column,
            self.survey.extents[column.name],
            runs,
            bins(runs),
            is_grid=self.text.is_grid,
            is_log=column.name in self.text.logarithmic,
        )

    def report(self) -> StudyReport:
        """Return the report."""
        names = file_names()
        predictions, no_theory = self._predictions()
        others = len(self.varied) > 2
        maps = [
            PassMap(x, y, counts, prediction, others)
            for (x, y), counts, prediction in zip(
                self.pairs, self.tallies.maps, predictions, strict=True
            )
        ]
        map_figures = [
            _chart_figure(names, 'map', [each.x.column.name, each.y.column.name], each)
            for each in maps
        ]
        shares = [
            _chart_figure(names, 'share', [axis.column.name], ShareChart(axis, counts))
            for axis, counts in zip(self.axes, self.tallies.shares, strict=True)
        ]
        measured = zip(
            self.summary.measures, self.edges.values(), self.tallies.histograms, strict=True
        )
        histograms = [
            _chart_figure(names, 'distribution', [each.column.name], Histogram(each, edges, counts))
            for each, edges, counts in measured
            if each.count
        ]
        sensitivity = self._sensitivity()
        files = {
            f'{figure.name}_lines.csv': csv_of(each.line_table())
            for figure, each in zip(map_figures, maps, strict=True)
        }
        measures = self._measures()
        figures = [*map_figures, *shares, *histograms]
        if sensitivity:
            figures.append(sensitivity['figure'])
        page = render_template(
            'study.html',
            package='ballbot_ros.lab.studies',
            title=self.data.study.name,
            text=self.text,
            banner=self._banner(),
            outcome=outcome_text(self.summary),
            facts=self._facts(),
            varied=self._varied(),
            measures=measures,
            quantiles=[f'{100.0 * each:g} %' for each in QUANTILES],
            maps=map_figures,
            no_theory=no_theory,
            mapped=len({axis.column.name for pair in self.pairs for axis in pair}),
            shares=shares,
            histograms=histograms,
            sensitivity=sensitivity,
            min_sample=MIN_SAMPLE,
            slices=SLICES,
            failed=[
                run_row(self.data, number) for number in islice(self.data.failed(), FAILED_SHOWN)
            ],
            failed_count=self.summary.totals.failed,
            versions=self._versions(),
            endings=ending_table(endings_of(self.data)),
            number_command=self._rerun('NUMBER'),
            worst_command=self._rerun('--worst', 'MEASURE'),
            interactive=_interactive(figures),
            missing=MISSING,
        )
        return StudyReport(page, figures, files)

    def _rerun(self, *words: object) -> str:
        return own_command('study', 'rerun', self.data.path, *words)

    def _banner(self) -> list[str]:
        done, study = self.survey.totals.runs, self.data.study
        if not self.data.missing:
            return []
        progress = f'This study is not finished: {done:,} of {study.runs:,} runs are done.'
        return [f'{progress} Give the command of the study again to do the others.']

    def _facts(self) -> list[tuple[str, str]]:
        study, totals = self.data.study, self.summary.totals
        manifest = self.data.manifest
        facts = [
            ('Runs', f'{totals.runs:,}'),
            ('Passed', f'{totals.passed:,}'),
            ('Fallen', f'{totals.fallen:,}'),
            ('Failed', f'{totals.failed:,}'),
            ('Seed', str(study.seed)),
            ('Sampling', self.text.sampling),
            ('Version', f'{study.versions.ballbot_ros}, code {study.code_sha256[:12]}'),
            ('Begun', manifest.begun.replace('T', ' ')),
        ]
        if self.text.redesign:
            facts.append(('Gains', f'designed for each robot: {self.text.redesign}'))
        if manifest.finished:
            facts.append(('Finished', manifest.finished.replace('T', ' ')))
        return facts

    def _varied(self) -> list[tuple[str, str, str, str]]:
        return [
            (
                each.name,
                '' if each.unit == '1' else each.unit,
                self.text.distributions.get(each.name, ''),
                each.meaning,
            )
            for each in self.varied
        ]

    def _versions(self) -> list[tuple[str, str]]:
        study = self.data.study
        versions = [
            (name, value or 'not installed') for name, value in vars(study.versions).items()
        ]
        return [*versions, ('SHA-256 of the code', study.code_sha256)]

    def _predictions(self) -> tuple[list[PredictedLimit | None], str]:
        """Return the prediction for each map, and why there are none at all, or an empty text."""
        if self.text.redesign:
            return [None] * len(self.pairs), 'the gains are designed for each robot'
        names = [each.name for each in self.varied]
        varied = {name: self.survey.sample[name] for name in names if not is_event(name)}
        try:
            with TemporaryDirectory(prefix='ballbot_report_') as folder:
                parameters = study_parameters(self.data.study, Path(folder) / 'study.yaml')
            usual = with_values(parameters, usual_values(varied))
        except BallbotError as error:
            # Such as a map or a controller that is not on this machine.
            return [None] * len(self.pairs), f"the parameters can't be read here: {one_line(error)}"
        return [predict(usual, x, y) for x, y in self.pairs], ''

    def _sensitivity(self) -> dict[str, Any] | None:
        """Return the section with the indices, the variables with the most influence first."""
        found = self.found
        if not found.variables or np.isnan(found.pawn).all():
            return None
        runs = self.survey.totals.runs
        notes = []
        if found.sampled < runs:
            notes.append(
                f'The indices are those of {found.sampled:,} of the {runs:,} runs, drawn at random.'
            )
        for name, count in zip(found.results, found.counts.tolist(), strict=True):
            if count < found.sampled:
                without = f'{found.sampled - count:,} of {found.sampled:,} runs'
                notes.append(f'{name}: {without} have no value and are left out.')
        order = np.argsort(-found.influence(), kind='stable').tolist()
        if np.isnan(found.floor[-1]):
            order = []  # passing does not vary
        rows = [
            (
                found.variables[place],
                _plus_minus(found.first_order[place, -1], found.half_width[place, -1]),
                number_text(float(found.pawn[place, -1])),
            )
            for place in order
        ]
        figure = _figure(
            'sensitivity',
            'Sensitivity indices',
            'Both indices of each varied value for each measure, and for passing. A dash: the '
            'result does not vary, or too few runs have a value.',
            sensitivity_figure(found),
            sensitivity_table(found),
        )
        return {'found': found, 'figure': figure, 'rows': rows, 'notes': notes}

    def _measures(self) -> list[dict[str, object]]:
        """Return the measures in the tables of the page, with the worst runs of each."""
        return [
            {
                'name': each.column.name,
                'unit': each.column.unit,
                'meaning': each.column.meaning,
                'expected': bounds_text(each.column.minimum, each.column.maximum).replace('-', '−'),
                'quantiles': [number_text(value) for value in each.quantiles.tolist()],
                'missing': each.missing,
                'worst': [run_row(self.data, run.number, run.value) for run in each.worst],
            }
            for each in self.summary.measures
        ]


def several_report(folder: Path) -> StudyReport | None:
    """Return the page of the studies of several scenarios and controllers; None without any."""
    endings = endings_below(folder)
    if not endings:
        return None
    page = render_template(
        'endings.html',
        package='ballbot_ros.lab.studies',
        title=folder.name,
        table=ending_table(endings),
        command=own_command('study', 'rerun', folder / 'SCENARIO/CONTROLLER', 'NUMBER'),
    )
    return StudyReport(page, [], {})


def run_row(
    data: StudyData, number: int, value: float | None = None, controller: str | None = None
) -> dict[str, object]:
    """Return a run of a study as a row of a page's table, with the command that repeats it.

    `value` is that of a measure, `controller` the study's if the command needs to name it.
    """
    row = data.row(number)
    words = () if controller is None else ('--controller', controller)
    return {
        'number': number,
        'value': '' if value is None else number_text(value),
        'varied': _varied_text(row, data.study),
        'verdict': _verdict(row),
        'command': own_command('study', 'rerun', data.path, number, *words),
    }


def file_names() -> Callable[..., str]:
    """Return a function that makes a file's name of words, such as variables; each only once."""
    taken = set[str]()

    def name_of(*words: str) -> str:
        plain = '__'.join(re.sub(r'[^\w.]+', '_', each).strip('_') for each in words)
        name, number = plain, 1
        while name.lower() in taken:
            number += 1
            name = f'{plain}_{number}'
        taken.add(name.lower())
        return name

    return name_of


@dataclass(frozen=True)
class StudyFigure(RenderedFigure):
    """A picture with its numbers, and the chart that an interactive page shows instead."""

    chart: ChartFigure


def _figure(name: str, title: str, caption: str, chart: ChartFigure, table: Table) -> StudyFigure:
    return StudyFigure(name, title, caption, png_of(chart.draw()), table, chart)


def _interactive(figures: Sequence[StudyFigure]) -> InteractiveFigures | None:
    charts = {f'chart_{each.name}': each.chart for each in figures}
    return packed_figures(
        lambda _: {name: chart.description() for name, chart in charts.items()},
        (each.name for each in figures),
    )


def _chart_figure(
    names: Callable[..., str],
    kind: str,
    columns: list[str],
    chart: PassMap | ShareChart | Histogram,
) -> StudyFigure:
    name, title = names(kind, *columns), ' × '.join(columns)
    return _figure(name, title, chart.caption(), chart.figure(), chart.table())


def outcome_text(summary: StudySummary) -> str:
    """Return the share that passed, with its interval."""
    low, high = (100.0 * each for each in summary.interval)
    share = 100.0 * summary.share_passed
    return f'{share:.3g} % passed; 95 % interval (Wilson) {low:.3g} … {high:.3g} %'


def _plus_minus(value: float, half: float) -> str:
    # The sum has no -0.0.
    text = f'{round(value, 3) + 0.0:.3f} ± {half:.3f}'
    return '–' if np.isnan(value) else text.replace('-', '−')


def _verdict(row: RunResults) -> str:
    if row.outcome == 'failed':
        return 'failed'
    verdict = 'passed' if row.passed else 'not passed'
    return f'{verdict}, fallen' if row.fallen else verdict


def _varied_text(row: RunResults, study: StudyRecord) -> str:
    units = {each.name: '' if each.unit in ('', '1') else f' {each.unit}' for each in study.varied}
    values = row.varied
    return ', '.join(f'{name} = {value_text(values[name])}{unit}' for name, unit in units.items())


def value_text(value: object) -> str:
    """Return a value of a parameter with 4 digits."""
    if isinstance(value, bool):
        return str(value).lower()
    return f'{value:.4g}'.replace('-', '−') if isinstance(value, float) else str(value)
