"""`ballbot report`: what a recorded run came to, as a page, figures and tables."""

from __future__ import annotations

import json
from pathlib import Path

import click

from ballbot_ros.analysis.page import check_folder
from ballbot_ros.analysis.report import banner, write_report
from ballbot_ros.cli.reading import read_and_assess


def report(recording: Path, *, number: int | None, output: Path | None, as_json: bool) -> int:
    """Write the report of a recording; print the verdict and where the page is."""
    folder = output or recording.with_name(f'{recording.stem}_report')
    check_folder(folder)
    assessment = read_and_assess(recording, number)
    for line in banner(assessment.run):
        click.echo(f'note: {line}', err=True)
    write_report(assessment, folder)
    page = folder / 'index.html'
    if as_json:
        content = {**assessment.as_json(), 'report': str(page)}
        click.echo(json.dumps(content, indent=2, allow_nan=False))
    else:
        reason = f': {assessment.reason}' if assessment.reason else ''
        click.echo(f'{assessment.outcome}{reason}')
        click.echo(f'report  {page}')
    return 0
