"""What `ballbot study` prints about its results."""

from __future__ import annotations

import json
import shlex

from rich.console import Console
from rich.table import Table

from ballbot_ros.analysis.metrics import number
from ballbot_ros.cli.study_progress import share_text
from ballbot_ros.study.study_data import QUANTILES, MeasureSummary, StudyData

WORST_SHOWN = 3


def print_summary(data: StudyData) -> None:
    """Print share passed, quantiles of the measures, and the worst runs."""
    summary, study = data.summary(WORST_SHOWN), data.study
    totals = summary.totals
    console = Console(highlight=False, markup=False)
    title = f'{study.name}, {totals.runs:,} runs, seed {study.seed}'
    table = Table(title=title, title_justify='left')
    table.add_column('measure')
    for quantile in QUANTILES:
        table.add_column(f'{100 * quantile:g} %', justify='right')
    table.add_column('expected')
    table.add_column('worst runs')
    for each in summary.measures:
        _add_measure(table, each)
    console.print(table)
    lines = [f'passed  {share_text(totals)}']
    if totals.failed:
        lines.append(f'failed  {totals.failed:,} runs ended early')
    if totals.fallen:
        lines.append(f'fallen  {totals.fallen:,} robots')
    lines.append(f'results  {data.path}')
    shown = next((each.worst[0].number for each in summary.measures if each.worst), 0)
    folder = shlex.quote(str(data.path))
    lines.append(f'one run again  ballbot study rerun {folder} {shown}')
    for line in lines:
        console.print(line, soft_wrap=True)


def _add_measure(table: Table, summary: MeasureSummary) -> None:
    column = summary.column
    unit = f' {column.unit}' if column.unit else ''
    missing = f' ({summary.missing:,} without)' if summary.missing else ''
    table.add_row(
        f'{column.name}{missing}',
        *(f'{value:.4g}{unit}' for value in summary.quantiles),
        _bounds(summary),
        ', '.join(str(each.number) for each in summary.worst),
    )


def _bounds(summary: MeasureSummary) -> str:
    low, high = summary.column.minimum, summary.column.maximum
    parts = [f'≥ {low:g}'] if low is not None else []
    parts += [f'≤ {high:g}'] if high is not None else []
    return ' and '.join(parts)


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
                'worst': [
                    {'number': run.number, 'value': number(run.value)} for run in each.worst
                ],
            }
            for each in summary.measures
        },
        'results': str(data.path),
    }
    print(json.dumps(content, indent=2, allow_nan=False))
