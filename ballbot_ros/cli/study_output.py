"""What `ballbot study` prints about its results."""

from __future__ import annotations

import json

from rich.console import Console
from rich.measure import Measurement
from rich.table import Table

from ballbot_ros.analysis.metrics import number
from ballbot_ros.cli.study_progress import share_text
from ballbot_ros.own_command import own_command
from ballbot_ros.scenario.scenario import bounds_text
from ballbot_ros.studies.columns import MeasureColumn
from ballbot_ros.studies.study_data import QUANTILES, MeasureSummary, StudyData, StudySummary

WORST_SHOWN = 3
_UNLIMITED = 10_000


def print_summary(data: StudyData) -> None:
    """Print the share that passed, quantiles of the measures, and the worst runs."""
    summary, study = data.summary(WORST_SHOWN), data.study
    console = Console(highlight=False, markup=False)
    count = summary.totals.runs
    title = f'{study.name}, {count:,} run{"s" * (count > 1)}, seed {study.seed}'
    quantiles = Table(title=title, title_justify='left')
    quantiles.add_column('measure', no_wrap=True)
    for share in QUANTILES:
        quantiles.add_column(f'{100 * share:g} %', justify='right', no_wrap=True)
    worst = Table()
    worst.add_column('measure', no_wrap=True)
    worst.add_column('expected', no_wrap=True)
    worst.add_column('worst values, and the numbers of their runs')
    for each in summary.measures:
        quantiles.add_row(_name(each.column), *(f'{value:.3g}' for value in each.quantiles))
        worst.add_row(
            each.column.name,
            bounds_text(each.column.minimum, each.column.maximum),
            _worst_runs(each),
        )
    # A number or a name that is cut off would be of no use.
    unlimited = console.options.update(max_width=_UNLIMITED)
    console.width = max(
        console.width, Measurement.get(console, unlimited, quantiles).maximum,
        Measurement.get(console, unlimited, worst).minimum,
    )  # fmt: skip
    console.print(quantiles)
    console.print(worst)
    for line in _lines(data, summary):
        console.print(line, soft_wrap=True)


def _lines(data: StudyData, summary: StudySummary) -> list[str]:
    totals, measures = summary.totals, summary.measures
    lines = [f'passed   {share_text(totals)}']
    if totals.failed:
        lines.append(f'failed   {totals.failed:,} of the runs: ended early')
    if totals.fallen:
        lines.append(f'fallen   {totals.fallen:,} of the robots')
    if totals.runs > 1 and _all_alike(data):
        lines.append('note     all runs have the same duties: what varies has no effect here')
    lines.append(f'results  {data.path}')
    shown = next((each.worst[0].number for each in measures if each.worst), 0)
    lines.append(f'again    {own_command("study", "rerun", data.path, shown)}')
    return lines


def _all_alike(data: StudyData) -> bool:
    """Return whether all runs have the same duties."""
    known = None
    for part in data.parts(['duty_sha256']):
        hashes = set(part['duty_sha256'].to_pylist())
        if len(hashes) > 1 or (known is not None and hashes != known):
            return False
        known = hashes
    return True


def _name(column: MeasureColumn) -> str:
    return f'{column.name} [{column.unit}]' if column.unit else column.name


def _worst_runs(summary: MeasureSummary) -> str:
    runs = ', '.join(f'{each.value:.3g} ({each.number})' for each in summary.worst)
    missing = f'without a value: {summary.missing:,}' if summary.missing else ''
    return '; '.join(filter(None, (runs, missing)))


def print_json(data: StudyData) -> None:
    """Print the summary as one JSON object; a missing number is null."""
    summary, study = data.summary(WORST_SHOWN), data.study
    content = {
        'study': study.name,
        'runs': summary.totals.runs,
        'seed': study.seed,
        'passed': summary.totals.passed,
        'failed': summary.totals.failed,
        'fallen': summary.totals.fallen,
        'share_passed': number(summary.share_passed),
        'share_passed_interval': list(summary.interval),
        'measures': {
            each.column.name: {
                'unit': each.column.unit,
                'missing': each.missing,
                'quantiles': {
                    f'{quantile:g}': number(float(value))
                    for quantile, value in zip(QUANTILES, each.quantiles, strict=True)
                },
                'worst': [{'number': run.number, 'value': number(run.value)} for run in each.worst],
            }
            for each in summary.measures
        },
        'results': str(data.path),
    }
    print(json.dumps(content, indent=2, allow_nan=False))
