"""Progress bar for work on a file."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager

from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeRemainingColumn

from ballbot_ros.cli.progress import ProgressLines, stderr_console
from ballbot_ros.progress import PROGRESS_PERIOD_S, ProgressCallback


@contextmanager
def file_progress(name: str, unit: str = '') -> Iterator[ProgressCallback]:
    """Show the progress: on a terminal as a bar, with a number if there is a unit, else as lines.

    Yields
    ------
    callable
        Accepts the amount done and the total; cheap enough to be called at every message.
    """
    console = stderr_console()
    with (
        ProgressLines(name, console) as lines,
        Progress(
            TextColumn('{task.description}', markup=False),
            BarColumn(bar_width=40),
            TextColumn(f'{{task.completed}}/{{task.total}} {unit}')
            if unit
            else TaskProgressColumn(),
            TimeRemainingColumn(),
            console=console,
            transient=True,
            disable=not console.is_terminal,
        ) as bar,
    ):
        task = bar.add_task(name, total=None)
        due = 0.0

        def update(done: int, total: int) -> None:
            nonlocal due
            if (now := time.monotonic()) < due:
                return
            due = now + PROGRESS_PERIOD_S
            # A file may have more than it says.
            lines.text = f'{min(done / max(total, 1), 1.0):.0%}'
            bar.update(task, completed=done, total=total)

        yield update
