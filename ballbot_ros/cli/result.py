"""What a run came to: verdict, table and JSON."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table
from rich.text import Text

from ballbot_ros.analysis.metrics import Judgement, number
from ballbot_ros.scenario.metric_registry import label as metric_label

PASSED, NOT_MET, FAILED, STOPPED = 'passed', 'expectations not met', 'failed', 'stopped'


@dataclass(frozen=True)
class Verdict:
    """Outcome of a run, in one word and in one line, and the exit status it gives."""

    outcome: str
    reason: str
    exit_status: int

    @classmethod
    def of(cls, summary: Mapping[str, Any], judgements: Sequence[Judgement]) -> Verdict:
        """Judge a run by the plant's summary and what came of the scenario's expectations."""
        if summary['outcome'] == STOPPED:
            return cls(STOPPED, summary['reason'], int(summary.get('exit_status', 130)))
        if summary['outcome'] == FAILED:
            return cls(FAILED, summary['reason'], int(summary.get('exit_status', 1)))
        failures = [judgement for judgement in judgements if not judgement.holds]
        if failures:
            return cls(NOT_MET, ', '.join(map(str, failures)), 1)
        return cls(PASSED, '', 0)

    def without_picture(self, reason: str) -> Verdict:
        """Return the verdict of a run whose picture could not be written."""
        outcome = FAILED if self.exit_status == 0 else self.outcome
        return Verdict(outcome, f'{self.reason}; {reason}'.lstrip('; '), self.exit_status or 1)


@dataclass
class Result:
    """Everything that is printed of a run."""

    scenario: str
    processes: str
    seed: int
    recording: Path | None
    figure: Path | None
    metrics: Mapping[str, float]
    verdict: Verdict
    summary: Mapping[str, Any]
    judgements: Sequence[Judgement]

    @property
    def is_judged(self) -> bool:
        """Whether the run came to its end, so that its expectations hold or do not."""
        return self.summary['outcome'] not in (STOPPED, FAILED)


def print_json(result: Result) -> None:
    """Print the result as one JSON object; a number that is not there is null."""
    summary = result.summary
    content = {
        'scenario': result.scenario,
        'processes': result.processes,
        'seed': result.seed,
        'outcome': result.verdict.outcome,
        'reason': result.verdict.reason,
        'duty_sha256': summary.get('duty_sha256'),
        'ticks': summary.get('ticks'),
        'real_time_factor': summary.get('real_time_factor'),
        'missed_ticks': summary.get('missed_ticks'),
        'asked_again': summary.get('asked_again'),
        'round_trip_ms': summary.get('round_trip_ms'),
        'participants': summary.get('participants', []),
        'recording': None if result.recording is None else str(result.recording),
        'figure': None if result.figure is None else str(result.figure),
        'metrics': {name: number(value) for name, value in result.metrics.items()},
        'expectations': [
            {**each.as_json(), 'holds': each.holds if result.is_judged else None}
            for each in result.judgements
        ],
    }
    print(json.dumps(content, indent=2, allow_nan=False))


def print_table(result: Result) -> None:
    """Print the result as a table, and where the files are."""
    console = Console(highlight=False, markup=False)
    table = Table(title=f'{result.scenario}, seed {result.seed}', title_justify='left')
    table.add_column('metric')
    table.add_column('value', justify='right')
    table.add_column('expected')
    table.add_column('')
    whole = {
        each.expectation.metric: each
        for each in result.judgements
        if each.expectation.is_of_the_whole_run
    }
    for name, value in result.metrics.items():
        _add_metric(table, name, value, whole.get(name), marked=result.is_judged)
    for each in result.judgements:
        if not each.expectation.is_of_the_whole_run:
            _add_metric(table, each.expectation.metric, each.value, each, marked=result.is_judged)
    summary = result.summary
    table.add_section()
    if summary.get('real_time_factor'):
        table.add_row('real-time factor', f'{summary["real_time_factor"]:.1f}', '', '')
    trip = summary.get('round_trip_ms')
    if trip:
        text = ' / '.join(f'{trip[key]:.2f}' for key in ('p50', 'p99', 'max'))
        table.add_row('tick round trip p50 / p99 / max', f'{text} ms', '', '')
    table.add_row('ticks', str(summary.get('ticks', 0)), '', '')
    table.add_row('missed ticks', str(summary.get('missed_ticks', 0)), '', '')
    console.print(table)
    verdict = result.verdict
    colour = 'green' if verdict.exit_status == 0 else 'red'
    reason = f': {verdict.reason}' if verdict.reason else ''
    console.print(Text.assemble((verdict.outcome, colour), reason), soft_wrap=True)
    for label, path in (('recording', result.recording), ('picture', result.figure)):
        if path:
            console.print(f'{label}  {path}', soft_wrap=True)


def _add_metric(
    table: Table, name: str, value: float, judgement: Judgement | None, *, marked: bool
) -> None:
    words, unit = metric_label(name)
    space = '' if unit in ('', '°') else ' '
    shown, expected, mark = f'{value:.3f}{space}{unit}', '', Text()
    if math.isnan(value):
        shown = 'never' if name == 'settling_time_s' else '–'
    if judgement:
        expected = str(judgement.expectation)
        if marked:
            mark = Text('✓', 'green') if judgement.holds else Text('✗', 'red')
        if judgement.expectation.window:
            words = f'{words}, {judgement.expectation.window}'
    table.add_row(words, shown, expected, mark)
