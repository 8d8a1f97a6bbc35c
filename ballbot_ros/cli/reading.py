"""Reading recordings for a command, with a progress bar on the terminal."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, TaskProgressColumn, TextColumn, TimeRemainingColumn
from rich.progress import Progress as Bar

from ballbot_ros.analysis.assessment import Assessment, assess
from ballbot_ros.analysis.run_data import read_run


@contextmanager
def bar(description: str) -> Iterator[Callable[[int, int], None]]:
    """Show on a terminal how far a work has got; yield what takes done and total."""
    console = Console(stderr=True, highlight=False)
    with Bar(
        TextColumn('{task.description}', markup=False),
        BarColumn(bar_width=40),
        TaskProgressColumn(),
        TimeRemainingColumn(),
        console=console,
        transient=True,
        disable=not console.is_terminal,
    ) as shown:
        task = shown.add_task(description, total=None)
        yield lambda done, total: shown.update(task, completed=done, total=total)


def read_and_assess(path: Path, number: int | None = None) -> Assessment:
    """Read a run and measure it; on a terminal show how far it has got."""
    with bar(path.name) as progress:
        run = read_run(path, number, progress)
    with bar(f'{path.name}: measuring'):
        return assess(run)
