"""Reading recordings in a command, with progress."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import click
import numpy as np
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeRemainingColumn

from ballbot_ros.analysis.assessment import Assessment, assess
from ballbot_ros.analysis.run_data import read_run
from ballbot_ros.cli.progress import ProgressLines, stderr_console
from ballbot_ros.process import PROGRESS_PERIOD_S, ProgressCallback
from ballbot_ros.robot.world.floor_map import FloorMap
from ballbot_ros.viewer.playback_run import PlaybackRun


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


def read_and_assess(path: Path, number: int | None = None) -> Assessment:
    """Read and measure a run, with a progress bar on a terminal."""
    with file_progress(path.name) as progress:
        run = read_run(path, number, progress)
    with file_progress(f'{path.name}: measuring'):
        return assess(run)


def read_playback_run(path: Path) -> PlaybackRun:
    """Read a run for display, with a warning if its file is damaged."""
    with file_progress(path.name) as progress:
        run = PlaybackRun(path, progress)
    if run.damage:
        click.echo(f'{path}: {run.damage}; the run is shown up to {run.end:.3f} s', err=True)
    return run


def read_playback_runs(path: Path, other: Path | None) -> list[PlaybackRun]:
    """Read a run and, if there is one, its ghost; warn if they are on different maps."""
    runs = [read_playback_run(each) for each in (path, other) if each]
    if len(runs) > 1 and not _same_map(runs[0].floor_map, runs[1].floor_map):
        click.echo(f'note: {other} is on another map; the map shown is that of {path}', err=True)
    return runs


def _same_map(a: FloorMap | None, b: FloorMap | None) -> bool:
    if a is None or b is None:
        return a is b
    return np.array_equal(a.cells, b.cells)
