"""Reading a recorded run in a command, with progress."""

from __future__ import annotations

from pathlib import Path

import click

from ballbot_ros.analysis.assessment import Assessment, assess
from ballbot_ros.analysis.run_data import read_run
from ballbot_ros.cli.file_progress import file_progress
from ballbot_ros.viewer.playback_run import PlaybackRun


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
