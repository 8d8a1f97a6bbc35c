"""`ballbot report`: assessment of a recorded run as a page, figures and tables."""

from __future__ import annotations

import json
from pathlib import Path

import click

from ballbot_ros.cli.install import offer
from ballbot_ros.cli.options import RECORDING, folder_option


@click.command('report')
@click.argument('recording', type=RECORDING)
@folder_option(
    'page, pictures and tables; it must be new or empty.  [default: <recording>_report next to it]'
)
@click.option(
    '--run',
    'number',
    type=click.IntRange(1),
    help='Number of the run in a file with several, from 1.  [default: the last]',
)
@click.option('--json', 'as_json', is_flag=True, help='Print one JSON object.')
def command(recording: Path, output: Path | None, number: int | None, as_json: bool) -> int:
    """Write a report of RECORDING: an index.html that needs no other file, its PNGs and CSVs.

    Exit status: 0 if the report was written, whatever its verdict; 2 for invalid arguments or a
    file that is not a recording of a ballbot.
    """
    offer('report')
    # Imported only here: it takes half a second.
    from ballbot_ros.analysis.page import check_folder
    from ballbot_ros.analysis.recorded_scenario import outside_pushes
    from ballbot_ros.analysis.report import banner, write_report
    from ballbot_ros.analysis.run_data import read_run
    from ballbot_ros.cli.recordings import parent_of, read_and_assess

    folder = output or recording.with_name(f'{recording.stem}_report')
    check_folder(folder)
    assessment = read_and_assess(recording, number)
    for line in banner(assessment.run):
        click.echo(f'note: {line}', err=True)
    earlier = parent_of(recording)
    write_report(assessment, folder, read_run(*earlier) if earlier else None)
    page = folder / 'index.html'
    if as_json:
        content = {**assessment.as_json(), 'report': str(page)}
        click.echo(json.dumps(content, indent=2, allow_nan=False))
    else:
        reason = f': {assessment.reason}' if assessment.reason else ''
        click.echo(f'{assessment.outcome}{reason}')
        if outside := outside_pushes(assessment.run.pushes):
            click.echo(outside)
        click.echo(f'report  {page}')
    return 0
