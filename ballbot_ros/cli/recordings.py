"""Reading recordings in a command, with progress."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click
import numpy as np

from ballbot_ros.analysis.assessment import Assessment, assess
from ballbot_ros.analysis.parent import Parent
from ballbot_ros.analysis.run_data import read_run
from ballbot_ros.cli.progress import file_progress
from ballbot_ros.recording.messages.recording_files import open_recording
from ballbot_ros.robot.world.floor_map import FloorMap

if TYPE_CHECKING:
    from ballbot_ros.viewer.playback_run import PlaybackRun


def read_and_assess(path: Path, number: int | None = None) -> Assessment:
    """Read and measure a run, with a progress bar on a terminal."""
    with file_progress(path.name) as progress:
        run = read_run(path, number, progress)
    with file_progress(f'{path.name}: measuring'):
        return assess(run)


def parent_of(path: Path) -> tuple[Path, int] | None:
    """Return file and number of the run of which one is a branch; None if it is none.

    If the file can't be found, it prints a note.
    """
    with open_recording(path) as reader:
        parent = Parent.decode(reader.attachments())
    if parent is None:
        return None
    found = parent.find(path)
    if found is None:
        click.echo(f'note: {path}: a branch of {parent}; that file is not next to it', err=True)
        return None
    return found, parent.run


def read_playback_run(path: Path, number: int | None = None) -> PlaybackRun:
    """Read a run for display, with a warning if its file is damaged."""
    from ballbot_ros.viewer.playback_run import PlaybackRun  # reports do not need the viewer

    with file_progress(path.name) as progress:
        run = PlaybackRun(path, progress, number)
    if run.damage:
        click.echo(f'{path}: {run.damage}; the run is shown up to {run.end:.3f} s', err=True)
    return run


def read_playback_runs(path: Path, other: Path | None) -> list[PlaybackRun]:
    """Read a run and its ghost, by default that of which it is a branch; warn of another map."""
    ghost = (other, None) if other else parent_of(path)
    runs = [read_playback_run(path), *([read_playback_run(*ghost)] if ghost else [])]
    if ghost:
        runs[1].align_with(runs[0])
    if ghost and not _same_map(runs[0].floor_map, runs[1].floor_map):
        click.echo(f'note: {ghost[0]} is on another map; the map shown is that of {path}', err=True)
    return runs


def _same_map(a: FloorMap | None, b: FloorMap | None) -> bool:
    if a is None or b is None:
        return a is b
    return np.array_equal(a.cells, b.cells)
