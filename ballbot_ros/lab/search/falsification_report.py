"""The report of a falsification: what was searched, and the runs that violate what is required."""

from __future__ import annotations

from typing import Any

from ballbot_ros.analysis.page import number_text, render_template
from ballbot_ros.controllers.loading import public_reference
from ballbot_ros.engine.scenario.scenario import bounds_text
from ballbot_ros.files import own_command
from ballbot_ros.lab.search.falsify import (
    COUNTEREXAMPLES,
    Counterexample,
    FalsificationResult,
    requirements_of,
)
from ballbot_ros.lab.search.report import METHODS, range_text
from ballbot_ros.lab.studies.job import job_of
from ballbot_ros.lab.studies.report import StudyReport, value_text
from ballbot_ros.lab.studies.variables import nominal_value
from ballbot_ros.parameters import ControllerParameters


def falsification_report(result: FalsificationResult) -> StudyReport:
    """Make the report of a falsification; its pictures are those next to the recordings."""
    study, job = result.of.study, job_of(result.of.study, result.folder)
    reference = study.spec.parameters.of(ControllerParameters).implementation
    page = render_template(
        'falsification.html',
        package='ballbot_ros.lab.search',
        title=study.name,
        purpose=study.purpose,
        outcome=_outcome(result),
        facts=[
            ('Runs', f'{result.runs:,} of {study.runs:,}'),
            ('Not passed', f'{result.violating:,}'),
            ('Scenario', study.spec.name),
            ('Controller', public_reference(reference)),
            ('Method', METHODS[result.of.method]),
            ('Seed', str(study.seed)),
            ('Version', f'{job.record.versions.ballbot_ros}, code {job.record.code_sha256[:12]}'),
        ],
        requirements=[
            (each.name, bounds_text(each.minimum, each.maximum).replace('-', '−'), each.meaning,
             each.unit, number_text(float(result.least[each.name][-1])))
            for each in requirements_of(study)
        ],
        variables=[
            (each.name, each.parameter.unit.removeprefix('1'),
             _value(nominal_value(study.spec, each)), range_text(each.distribution))
            for each in study.variables
        ],
        counterexamples=[
            _counterexample(result, rank, each)
            for rank, each in enumerate(result.counterexamples, 1)
        ],
    )  # fmt: skip
    return StudyReport(page, [], {})


def _outcome(result: FalsificationResult) -> str:
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
            (each.name, each.parameter.unit.removeprefix('1'),
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
