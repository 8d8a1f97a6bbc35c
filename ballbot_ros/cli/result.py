"""What a run came to: verdict, table and JSON."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from rich.console import Console
from rich.table import Table
from rich.text import Text

from ballbot_ros.analysis.metrics import Judgement, number
from ballbot_ros.cli.experiment import Processes
from ballbot_ros.scenario.metric_registry import label as metric_label
from ballbot_ros.simulation.outcome import Outcome
from ballbot_ros.simulation.run_result import RunResult

PASSED, NOT_MET = 'passed', 'expectations not met'


@dataclass(frozen=True)
class Verdict:
    """Outcome of a run, in one word and in one line, and the exit status it gives."""

    outcome: str
    reason: str
    exit_status: int

    @classmethod
    def of(cls, run: RunResult, judgements: Sequence[Judgement]) -> Verdict:
        """Judge a run by its result and what came of the scenario's expectations."""
        if run.outcome is not Outcome.COMPLETED:
            return cls(run.outcome.value, run.reason, run.exit_status)
        failures = [judgement for judgement in judgements if not judgement.holds]
        if failures:
            return cls(NOT_MET, ', '.join(map(str, failures)), 1)
        return cls(PASSED, '', 0)

    def without_picture(self, reason: str) -> Verdict:
        """Return the verdict of a run whose picture could not be written."""
        outcome = Outcome.FAILED.value if self.exit_status == 0 else self.outcome
        return Verdict(outcome, f'{self.reason}; {reason}'.lstrip('; '), self.exit_status or 1)


@dataclass
class Result:
    """Everything that is printed of a run."""

    scenario: str
    processes: Processes
    seed: int
    recording: Path | None
    figure: Path | None
    metrics: Mapping[str, float]
    verdict: Verdict
    run: RunResult
    judgements: Sequence[Judgement]

    @property
    def is_judged(self) -> bool:
        """Whether the run came to its end, so that its expectations hold or do not."""
        return self.run.outcome is Outcome.COMPLETED


def print_json(result: Result) -> None:
    """Print the result as one JSON object; a number that is not there is null."""
    run = result.run
    content = {
        'scenario': result.scenario,
        'processes': result.processes.value,
        'seed': result.seed,
        'outcome': result.verdict.outcome,
        'reason': result.verdict.reason,
        'duty_sha256': run.duty_sha256,
        'ticks': run.ticks,
        'real_time_factor': run.real_time_factor,
        'missed_ticks': run.late_ticks,
        'asked_again': run.resends,
        'round_trip_ms': run.round_trip._asdict() if run.round_trip else None,
        'participants': list(run.participants),
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
    run = result.run
    table.add_section()
    if run.real_time_factor:
        table.add_row('real-time factor', f'{run.real_time_factor:.1f}', '', '')
    if run.round_trip:
        text = ' / '.join(f'{trip_ms:.2f}' for trip_ms in run.round_trip)
        table.add_row('tick round trip p50 / p99 / max', f'{text} ms', '', '')
    table.add_row('ticks', str(run.ticks), '', '')
    table.add_row('missed ticks', str(run.late_ticks or 0), '', '')
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
