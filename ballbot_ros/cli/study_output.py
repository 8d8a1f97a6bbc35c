"""What `ballbot study` prints about its results."""

from __future__ import annotations

import json
import threading
import time
from collections.abc import Sequence
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, TextColumn, TimeRemainingColumn
from rich.progress import Progress as Bar
from rich.table import Column, Table

from ballbot_ros.analysis.metrics import number
from ballbot_ros.cli.options import MAX_TABLE_WIDTH, print_whole
from ballbot_ros.cli.progress import ProgressLines, stderr_console
from ballbot_ros.engine.scenario.scenario import bounds_text
from ballbot_ros.files import own_command
from ballbot_ros.lab.studies.execution import StudyObserver
from ballbot_ros.lab.studies.manifest import PartSummary
from ballbot_ros.lab.studies.outcomes import Ending, ending_table, endings_below, endings_of
from ballbot_ros.lab.studies.study_data import (
    QUANTILES,
    MeasureSummary,
    StudyData,
    StudySummary,
    wilson_interval,
)
from ballbot_ros.process import PROGRESS_PERIOD_S

_WITH_BAR = 110
"""Width of the terminal from which on there is room for the bar itself."""


class StudyProgress(StudyObserver):
    """A bar on a terminal; on a pipe or file notices, and a line every 10 s."""

    def __init__(self, name: str) -> None:
        self._console = stderr_console()
        self._lines = ProgressLines(name, self._console)
        self._bar = Bar(
            TextColumn('{task.description}', markup=False),
            *([BarColumn(bar_width=20)] if self._console.width >= _WITH_BAR else ()),
            TextColumn('{task.fields[text]}'),
            TimeRemainingColumn(compact=True),
            TextColumn('left  {task.fields[passed]}'),
            console=self._console,
            transient=True,
            disable=not self._console.is_terminal,
        )
        self._task = self._bar.add_task(name, total=None, text='starting', passed='')
        self._lock = threading.Lock()
        self._runs = self._written = self._simulated = 0
        self._summary = PartSummary()
        self._begun = self._shown = time.monotonic()

    def __enter__(self) -> StudyProgress:
        self._bar.start()
        self._lines.__enter__()
        return self

    def __exit__(self, *error: object) -> None:
        self._lines.__exit__()
        self._bar.stop()

    def begin(self, runs: int, done: PartSummary) -> None:
        """Show that a study of so many runs begins, or goes on after those that are done."""
        self._runs, self._written, self._summary = runs, done.runs, done
        self._simulated = 0
        self._begun = time.monotonic()
        self._lines.text = f'{done.runs:,}/{runs:,}'
        self._bar.reset(self._task, total=runs, completed=done.runs, text='', passed='')
        if done.runs and done.runs < runs:
            self.notice(f'goes on after {done.runs:,} of {runs:,} runs')

    def advance(self, runs: int) -> None:
        """Show that so many more runs have been simulated."""
        with self._lock:
            now = time.monotonic()
            if not self._simulated:  # what came before was no simulation, but compiling
                self._begun = now
            self._simulated += runs
            if now - self._shown < PROGRESS_PERIOD_S:
                return
            self._shown = now
            speed = self._simulated / max(now - self._begun, 1e-3)
            done = self._written + self._simulated
        self._lines.text = f'{done:,}/{self._runs:,}  {speed:,.0f} runs/s'
        self._bar.update(self._task, completed=done, text=f'{self._lines.text} ')

    def part(self, summary: PartSummary) -> None:
        """Show the share that passed, with the runs of another part."""
        self._summary += summary
        self._bar.update(self._task, passed=f'passed {share_text(self._summary)}')

    def notice(self, text: str) -> None:
        """Print a line above the bar."""
        self._console.print(text, soft_wrap=True)


class SearchProgress(StudyProgress):
    """The same for a search, with what is known after each generation."""

    def generation(self, text: str) -> None:
        """Show what is known after another generation."""
        self._bar.update(self._task, passed=text)
        self._lines.text = text

    def part(self, summary: PartSummary) -> None:
        """Show no share that passed."""


def share_text(summary: PartSummary) -> str:
    """Return the share of runs that passed and its interval, such as '96.2 % (95.9 … 96.5 %)'."""
    if not summary.runs:
        return 'none yet'
    interval = wilson_interval(summary.passed, summary.runs)
    share = summary.passed / summary.runs
    return f'{_percent(share)} % ({_percent(interval.low)} … {_percent(interval.high)} %)'


def _percent(share: float) -> str:
    """Return a share in percent, with more digits near 0 and 1."""
    percent = 100.0 * share
    distance = min(percent, 100.0 - percent)
    digits = 1 if distance >= 1.0 or distance == 0.0 else 3
    return f'{percent:.{digits}f}'


def print_summary(data: StudyData) -> None:
    """Print the share that passed, quantiles of the measures, and the worst runs."""
    summary, study = data.summary(), data.study
    console = Console(highlight=False, markup=False)
    count = summary.totals.runs
    title = f'{study.name}, {count:,} run{"s" * (count > 1)}, seed {study.seed}'
    shares = (Column(f'{100 * each:g} %', justify='right') for each in QUANTILES)
    quantiles = Table('measure', *shares, title=title, title_justify='left')
    whole = (Column(each, no_wrap=True) for each in ('measure', 'expected'))
    worst = Table(*whole, 'worst values, and the numbers of their runs')
    for each in summary.measures:
        unit = f' [{each.column.unit}]' if each.column.unit else ''
        name = f'{each.column.name}{unit}'
        quantiles.add_row(name, *(f'{value:.3g}' for value in each.quantiles))
        worst.add_row(
            each.column.name,
            bounds_text(each.column.minimum, each.column.maximum),
            _worst_runs(each),
        )
    print_whole(console, quantiles)
    # A name that is cut off would be of no use; the runs have several lines.
    unlimited = console.options.update(max_width=MAX_TABLE_WIDTH)
    least = console.measure(worst, options=unlimited).minimum
    console.width = max(console.width, least)
    console.print(worst)
    print_endings(endings_of(data))
    for line in _lines(data, summary):
        console.print(line, soft_wrap=True)


def print_endings(endings: Sequence[Ending]) -> None:
    """Print how runs ended, with the number of the worst, if words vary."""
    if len(endings) > 1:
        head, *rows = ending_table(endings)
        table = Table(*head, title='endings, and the worst runs', title_justify='left')
        for each in rows:
            table.add_row(*each)
        print_whole(Console(highlight=False, markup=False), table)


def print_results(folder: Path, *, as_json: bool) -> None:
    """Print the results of a study, or the endings of several studies, in a folder."""
    endings = endings_below(folder)
    if not endings:
        (print_study_json if as_json else print_summary)(StudyData.open(folder))
    elif as_json:
        content = {'outcomes': [each._asdict() for each in endings], 'results': str(folder)}
        print(json.dumps({'study': folder.name, **content}, indent=2))
    else:
        print_endings(endings)
        again = own_command('study', 'rerun', folder / 'SCENARIO/CONTROLLER', 'NUMBER')
        print(f'results  {folder}\nagain    {again}')


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
        hashes = set(part['duty_sha256'].tolist())
        if len(hashes) > 1 or (known is not None and hashes != known):
            return False
        known = hashes
    return True


def _worst_runs(summary: MeasureSummary) -> str:
    runs = ', '.join(f'{each.value:.3g} ({each.number})' for each in summary.worst)
    missing = f'without a value: {summary.missing:,}' if summary.missing else ''
    return '; '.join(filter(None, (runs, missing)))


def print_study_json(data: StudyData) -> None:
    """Print the summary as one JSON object; a missing number is null."""
    summary, study = data.summary(), data.study
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
        'outcomes': [each._asdict() for each in endings_of(data)],
        'results': str(data.path),
    }
    print(json.dumps(content, indent=2, allow_nan=False))
