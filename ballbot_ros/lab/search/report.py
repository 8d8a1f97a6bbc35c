"""The reports of a tuning and of a falsification: what was searched, how, and what was found."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from ballbot_ros import __version__
from ballbot_ros.analysis.chart import ChartFigure
from ballbot_ros.analysis.figure_parts import WIDTH, png_of
from ballbot_ros.analysis.loop_summary import MarginRow, margin_rows
from ballbot_ros.analysis.page import number_text, render_template
from ballbot_ros.analysis.run_figures import RenderedFigure
from ballbot_ros.controllers.design.linear_model import DesignError
from ballbot_ros.controllers.design.loop_analysis import analyse_sampled
from ballbot_ros.controllers.loading import is_installed, public_reference
from ballbot_ros.engine.compilation import code_sha256
from ballbot_ros.engine.scenario.reader import scenario_names
from ballbot_ros.engine.scenario.scenario import bounds_text
from ballbot_ros.files import own_command
from ballbot_ros.lab.search.charts import (
    NamedChart,
    around_chart,
    convergence_chart,
    path_chart,
    robots_chart,
)
from ballbot_ros.lab.search.falsify import (
    COUNTEREXAMPLES,
    Counterexample,
    FalsificationResult,
    requirements_of,
)
from ballbot_ros.lab.search.objective import INFEASIBLE
from ballbot_ros.lab.search.optimiser import Method
from ballbot_ros.lab.search.tune import AFTER, BEFORE, SEARCH, STEPS, TuningResult
from ballbot_ros.lab.studies.columns import MeasureColumn
from ballbot_ros.lab.studies.maps import PANEL_WIDTH
from ballbot_ros.lab.studies.programs import with_values
from ballbot_ros.lab.studies.report import (
    StudyReport,
    file_names,
    outcome_text,
    run_row,
    value_text,
)
from ballbot_ros.lab.studies.study_data import QUANTILES, StudyData
from ballbot_ros.lab.studies.survey import with_unit
from ballbot_ros.lab.studies.variables import (
    Distribution,
    Levels,
    LogUniform,
    Normal,
    Variable,
    WholeNumbers,
    nominal_value,
)
from ballbot_ros.parameters import DOCUMENTS_PROGRAM, ControllerParameters
from ballbot_ros.parameters.files import plain_values

AT_AN_END = 0.01
"""Share of its range from an end within which a value lies at that end."""

_BOTH = {BEFORE: 'start', AFTER: 'tuned'}
_DISCRETE = Levels, WholeNumbers
_METHODS = {Method.CMA: 'CMA-ES', Method.RANDOM: 'random search'}


def tuning_report(result: TuningResult) -> StudyReport:
    """Make the report of a tuning.

    It raises BallbotError if a study of the tuning can't be read.
    """
    return _Findings(result).report()


class _Findings:
    """All that is read and computed for a report."""

    def __init__(self, result: TuningResult) -> None:
        self.result, self.tuning, self.verdicts = result, result.tuning, result.verdicts
        self.objective = result.tuning.objective
        self.unseen = {each: list(map(StudyData.open, result.studies(each))) for each in _BOTH}
        self.summaries = {
            which: [each.summary() for each in data] for which, data in self.unseen.items()
        }
        self.judged = result.unseen()  # start, tuned
        self.values = [plain_values(result.values(each)) for each in (0, result.best)]
        self.record = self.unseen[AFTER][0].study
        weights = self.objective.weights
        self.measures = [each for each in self.record.measures if each.name in weights]
        self.parameters = self.tuning.studies[0].spec.parameters
        own = self.parameters.of(ControllerParameters).implementation
        self.controller = public_reference(own)
        self.is_known = own in DOCUMENTS_PROGRAM or is_installed(own)
        self.best_cost = float(self.verdicts.cost[result.best])
        self.names = file_names()

    def report(self) -> StudyReport:
        """Return the report."""
        result, tuning = self.result, self.tuning
        numbers = range(len(tuning.tuned))
        margins, no_margins = self._margins()
        searched = convergence_chart(self.verdicts, tuning.population)
        convergence = self._figure(['convergence'], searched, width=WIDTH)
        paths, robots = list(map(self._path, numbers)), list(self._robots())
        around = list(map(self._around, numbers)) if self.best_cost < INFEASIBLE else []
        page = render_template(
            'tuning.html',
            package='ballbot_ros.lab.search',
            title=tuning.name,
            purpose=tuning.studies[0].purpose,
            banner=self._banner(),
            outcome=self._outcome(),
            facts=self._facts(),
            at_ends=list(filter(None, map(self._at_end, numbers))),
            parameters=list(map(self._parameter, numbers)),
            convergence=convergence,
            broken=int((~self.verdicts.is_feasible).sum()),
            candidates=len(result.points),
            paths=paths,
            unseen=tuning.unseen,
            judged=self._rows_of_objective(),
            over=self.objective.over,
            scenarios=list(map(self._scenario, range(len(tuning.studies)))),
            quantiles=[f'{100.0 * each:g} %' for each in QUANTILES],
            robots=robots,
            margins=margins,
            no_margins=no_margins,
            is_known=self.is_known,
            steps=list(map(_percent, STEPS)),
            is_discrete=any(isinstance(each.distribution, _DISCRETE) for each in tuning.tuned),
            around=around,
            influences=self._influences() if around else [],
            is_converged=result.around.min() >= self.best_cost,
            uses=[
                own_command('run', _reference(each.spec.name), '--params', result.parameter_file)
                for each in tuning.studies
            ],
            reports=[own_command('study', 'report', each) for each in result.studies(SEARCH)],
        )
        figures = [convergence, *paths, *robots, *around]
        return StudyReport(page, figures, {})

    def _banner(self) -> list[str]:
        best = self.result.best
        found = [
            *self.objective.broken(self.verdicts, best),
            *(f'{each}, on robots not seen' for each in self.objective.broken(self.judged, 1)),
        ]
        lines = [f'The tuned values break a limit: {each}.'.replace('-', '−') for each in found]
        if not best:
            lines.append('No candidate is better than the start: the tuned values are the start.')
        elif self.judged.cost[1] >= self.judged.cost[0]:
            lines.append('On robots not seen by the search, the start is no worse.')
        for study, old, new in zip(self.tuning.studies, *self.summaries.values(), strict=True):
            if new.interval.high < old.interval.low:
                shares = (f'{100.0 * each.share_passed:.3g} %' for each in (new, old))
                lines.append(
                    f'On robots not seen by the search, fewer runs of {study.spec.name} pass: '
                    f'{" instead of ".join(shares)}.'
                )
        return lines

    def _outcome(self) -> str:
        before, after = self.judged.value.tolist()
        change = f' ({_percent(after / before - 1.0)})' if min(before, after) > 0.0 else ''
        is_kept = self.best_cost < INFEASIBLE and self.judged.is_feasible[1]
        return (
            f'Objective {_number(before)} → {_number(after)}{change} on robots not seen by the '
            f'search; lower is better. {len(self.result.points):,} candidates; the best one '
            f'{"keeps all limits" if is_kept else "breaks a limit"}.'
        )

    def _facts(self) -> list[tuple[str, str]]:
        study, versions = self.tuning.studies[0], self.record.versions
        scenarios = len(self.tuning.studies)
        each_of = f' in each of {scenarios} scenarios' if scenarios > 1 else ''
        terms = (f'{self.objective.weights[each.name]:g} × {_term(each)}' for each in self.measures)
        return [
            ('Objective', f'{self.objective.over} over the robots of {" + ".join(terms)}'),
            ('Controller', self.controller),
            ('Candidates', f'{len(self.result.points):,}'),
            ('Robots per candidate', f'{study.runs:,}{each_of}'),
            ('Method', f'{_METHODS[self.tuning.method]}, population {self.tuning.population:,}'),
            ('Seed', str(study.seed)),
            ('Version', f'{versions.ballbot_ros}, code {self.record.code_sha256[:12]}'),
            ('Python, numpy', f'{versions.python}, {versions.numpy}'),
        ]

    def _at_end(self, number: int) -> str:
        """Return the name of a parameter that is a number and at an end of its range, or ''."""
        variable = self.tuning.tuned[number]
        tuned = self.values[1][variable.name]
        share, of = self.result.points[self.result.best, number], variable.distribution
        is_at_end = not AT_AN_END < share < 1.0 - AT_AN_END
        if isinstance(of, _DISCRETE):
            is_at_end = not isinstance(tuned, bool | str) and tuned in of.ends
        return variable.name if is_at_end else ''

    def _parameter(self, number: int) -> tuple[str, ...]:
        """Return a tuned parameter in the table of the page."""
        variable = self.tuning.tuned[number]
        start, tuned = (each[variable.name] for each in self.values)
        share = self.result.points[self.result.best, number]
        return (
            variable.name,
            _unit(variable),
            range_text(variable.distribution),
            value_text(start),
            value_text(tuned),
            '' if isinstance(tuned, bool | str) else f'{100.0 * share:.0f} %',
        )

    def _rows_of_objective(self) -> list[tuple[str, ...]]:
        """Return the objective and the limits of both, on robots of the search and on others."""
        verdicts = [
            *((self.verdicts, each) for each in (0, self.result.best)),
            *((self.judged, each) for each in (0, 1)),
        ]
        most = f'≤ {100.0 * self.objective.tolerated:.3g} %'
        lost = (f'{100.0 * each.lost[at]:.3g} %' for each, at in verdicts)
        rows = [
            ('objective', '', *(_number(each.value[at]) for each, at in verdicts)),
            ('robots without a value', most, *lost),
        ]
        for number, limit in enumerate(self.objective.limits):
            values = (_number(each.limits[at, number]) for each, at in verdicts)
            rows.append((limit.name, str(limit).replace('-', '−'), *values))
        return rows

    def _scenario(self, number: int) -> dict[str, object]:
        """Return a scenario in the tables of the page, with the worst runs of the objective."""
        data, named = self.unseen[AFTER][number], None if self.is_known else self.controller
        both = {words: self.summaries[which][number] for which, words in _BOTH.items()}
        measured = zip(*(each.measures for each in both.values()), strict=True)
        return {
            'name': self.tuning.studies[number].spec.name,
            'passed': [
                (words, outcome_text(of), f'{of.totals.fallen:,}', f'{of.totals.failed:,}')
                for words, of in both.items()
            ],
            'rows': [
                (with_unit(each.column.name, each.column.unit), words,
                 *map(number_text, each.quantiles.tolist()),
                 number_text(each.worst[0].value) if each.worst else '–', f'{each.missing:,}')
                for pair in measured
                for words, each in zip(both, pair, strict=True)
            ],
            'worst': [
                (with_unit(each.column.name, each.column.unit),
                 [run_row(data, *run, named) for run in each.worst])
                for each in both['tuned'].measures
                if each.column.name in self.objective.weights
            ],
        }  # fmt: skip

    def _margins(self) -> tuple[list[MarginRow], str]:
        """Return the margins of start and tuned values, or why there are none."""
        values = map(self.result.values, (0, self.result.best))
        try:
            return margin_rows(
                *(analyse_sampled(with_values(self.parameters, each)) for each in values)
            ), ''
        except DesignError as error:
            return [], str(error)

    def _influences(self) -> list[tuple[str, ...]]:
        """Return the costs around the best candidate, the most influential parameter first."""
        around = self.result.around
        influence = np.abs(around - self.best_cost).max(axis=1)
        return [
            (
                self.tuning.tuned[number].name,
                *map(_cost, around[number].tolist()),
                _cost(float(influence[number])),
            )
            for number in np.argsort(-influence, kind='stable').tolist()
        ]

    def _path(self, number: int) -> RenderedFigure:
        variable, shares = self.tuning.tuned[number], self.result.points[:, number]
        chart = path_chart(variable, shares, self.verdicts.cost, self.tuning.population)
        return self._figure(['path', variable.name], chart, variable.parameter.description)

    def _robots(self) -> Iterator[RenderedFigure]:
        for number, study in enumerate(self.tuning.studies):
            words = [study.spec.name] if self.tuning.studies[1:] else []
            for column in self.measures:
                badness = (
                    column.badness(each[number].column(column.name))
                    for each in self.unseen.values()
                )
                chart = robots_chart(with_unit(_term(column), column.unit), *badness)
                yield self._figure(['robots', *words, column.name], chart, column.meaning)

    def _around(self, number: int) -> RenderedFigure:
        share, name = self.result.points[self.result.best, number], self.tuning.tuned[number].name
        # The changes end at the ends of the range.
        changes = np.clip(share + np.array(STEPS), 0.0, 1.0) - share
        chart = around_chart(name, changes, self.result.around[number], self.best_cost,
                             self.result.around)  # fmt: skip
        return self._figure(['around', name], chart)

    def _figure(
        self, words: list[str], named: NamedChart, meaning: str = '', width: float = PANEL_WIDTH
    ) -> RenderedFigure:
        png = png_of(ChartFigure([named.chart], width, 3.0).draw())
        caption = f'{meaning[:1].upper()}{meaning[1:]}.' if meaning else ''
        title = ', '.join(words[1:] or words)
        return RenderedFigure(self.names(*words), title, caption, png, named.table)


def falsification_report(result: FalsificationResult) -> StudyReport:
    """Make the report of a falsification; its pictures are those next to the recordings."""
    study = result.of.study
    reference = study.spec.parameters.of(ControllerParameters).implementation
    page = render_template(
        'falsification.html',
        package='ballbot_ros.lab.search',
        title=study.name,
        purpose=study.purpose,
        outcome=_falsified(result),
        facts=[
            ('Runs', f'{result.runs:,} of {study.runs:,}'),
            ('Not passed', f'{result.violating:,}'),
            ('Scenario', study.spec.name),
            ('Controller', public_reference(reference)),
            ('Method', _METHODS[result.of.method]),
            ('Seed', str(study.seed)),
            ('Version', f'{__version__}, code {code_sha256()[:12]}'),
        ],
        requirements=[
            (each.name, bounds_text(each.minimum, each.maximum).replace('-', '−'), each.meaning,
             each.unit, number_text(result.least[each.name]))
            for each in requirements_of(study)
        ],
        variables=[
            (each.name, _unit(each),
             _value(nominal_value(study.spec, each)), range_text(each.distribution))
            for each in study.variables
        ],
        counterexamples=[
            _counterexample(result, rank, each)
            for rank, each in enumerate(result.counterexamples, 1)
        ],
    )  # fmt: skip
    return StudyReport(page, [], {})


def _falsified(result: FalsificationResult) -> str:
    if not result.counterexamples:
        return f'No counterexample in {result.runs:,} runs. That does not prove that there is none.'
    count = len(result.counterexamples)
    return f'{count} counterexample{"s" * (count > 1)} in {result.runs:,} runs.'


def _counterexample(
    result: FalsificationResult, rank: int, found: Counterexample
) -> dict[str, Any]:
    study, scenario = result.of.study, found.scenario
    assert scenario is not None
    folder = f'{COUNTEREXAMPLES}/{rank}'
    recording = scenario.with_suffix('.mcap')
    return {
        'requirement': found.requirement,
        'number': found.number,
        'folder': folder,
        'figure': f'{folder}/{scenario.stem}.png',
        'is_same': found.is_same,
        'rows': [
            (each.name, _unit(each),
             _value(nominal_value(study.spec, each)), _value(found.found[each.name]),
             _value(found.shrunk[each.name]))
            for each in study.variables
        ],
        'commands': [
            own_command('run', scenario), own_command('view', recording),
            own_command('report', recording),
        ],
    }  # fmt: skip


def _value(value: object) -> str:
    return '–' if value is None else value_text(value)


def _unit(variable: Variable) -> str:
    unit = variable.parameter.unit
    return '' if unit == '1' else unit


def _term(column: MeasureColumn) -> str:
    """Return how a measure counts in an objective; see `MeasureColumn.badness`."""
    if column.minimum is not None and column.maximum is not None:
        return f'|{column.name} − {(column.minimum + column.maximum) / 2.0:g}|'
    return f'−{column.name}' if column.badness(np.ones(1))[0] < 0.0 else column.name


def range_text(of: Distribution) -> str:
    """Return the range of a distribution in words."""
    if isinstance(of, Levels):
        return ', '.join(map(value_text, of.levels))
    base = of.rounded if isinstance(of, WholeNumbers) else of
    kind = {LogUniform: ', logarithmic', Normal: ', normal'}.get(type(base), '')
    return f'{value_text(of.low)} … {value_text(of.high)}{kind}'


def _reference(scenario: str) -> str:
    return scenario if scenario in scenario_names() else f'{scenario}.yaml'


def _number(value: float) -> str:
    return '–' if np.isnan(value) else value_text(float(value))


def _cost(cost: float) -> str:
    return 'breaks a limit' if cost >= INFEASIBLE / 2.0 else _number(cost)


def _percent(share: float) -> str:
    return f'{100.0 * share:+.3g} %'.replace('-', '−')
