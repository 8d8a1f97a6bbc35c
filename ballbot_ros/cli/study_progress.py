"""Progress bar of a study: runs, speed, time left and the share that passed so far."""

from __future__ import annotations

import threading
import time

from rich.progress import BarColumn, TextColumn, TimeRemainingColumn
from rich.progress import Progress as Bar

from ballbot_ros.analysis.proportion import wilson_interval
from ballbot_ros.cli.progress import ProgressLines, stderr_console
from ballbot_ros.progress import PROGRESS_PERIOD_S
from ballbot_ros.studies.manifest import PartSummary

_WITH_BAR = 110
"""Width of the terminal from which on there is room for the bar itself."""


class StudyProgress:
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
