"""Reading and measuring a recorded run for a command."""

from __future__ import annotations

from pathlib import Path

from ballbot_ros.analysis.assessment import Assessment, assess
from ballbot_ros.analysis.run_data import read_run
from ballbot_ros.cli.file_progress import file_progress


def read_and_assess(path: Path, number: int | None = None) -> Assessment:
    """Read a run and measure it; on a terminal show how far it has got."""
    with file_progress(path.name) as progress:
        run = read_run(path, number, progress)
    with file_progress(f'{path.name}: measuring'):
        return assess(run)
