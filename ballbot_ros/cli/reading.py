"""Reading recordings for a command, with a progress bar on the terminal."""

from __future__ import annotations

from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, TaskProgressColumn, TextColumn, TimeRemainingColumn
from rich.progress import Progress as Bar

from ballbot_ros.analysis.assessment import Assessment, assess
from ballbot_ros.analysis.run_data import read_run


def read_and_assess(path: Path, number: int | None = None) -> Assessment:
    """Read a run and measure it; on a terminal show how far it has got."""
    console = Console(stderr=True, highlight=False)
    with Bar(
        TextColumn('{task.description}', markup=False),
        BarColumn(bar_width=40),
        TaskProgressColumn(),
        TimeRemainingColumn(),
        console=console,
        transient=True,
        disable=not console.is_terminal,
    ) as bar:
        task = bar.add_task(path.name, total=None)
        run = read_run(
            path, number, lambda done, total: bar.update(task, completed=done, total=total)
        )
        bar.update(task, description=f'{path.name}: measuring', total=None)
        return assess(run)
