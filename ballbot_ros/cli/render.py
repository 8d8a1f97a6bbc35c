"""`ballbot render`: pictures and films of a recorded run."""

from __future__ import annotations

from pathlib import Path

import click

from ballbot_ros.cli.file_progress import file_progress
from ballbot_ros.cli.path_types import NEW_FILE, RECORDING
from ballbot_ros.stop_request import defer_sigint
from ballbot_ros.viewer.address import require_viser
from ballbot_ros.viewer.browser import browser_program
from ballbot_ros.viewer.errors import ViewerError, importing
from ballbot_ros.viewer.views import VIEWS

OUTPUT_SUFFIXES = ('.png', '.gif', '.mp4')


@click.command('render')
@click.argument('recording', type=RECORDING)
@click.option(
    '--view', type=click.Choice(VIEWS), default='chaser1', show_default=True, help='The view.'
)
@click.option(
    '--output',
    required=True,
    type=NEW_FILE,
    help='File to write: a picture (.png) or a film (.mp4, .gif).',
)
@click.option(
    '--time',
    'moment',
    type=click.FloatRange(0.0),
    help='Time of a picture from the start of the run [s].  [default: the end]',
)
def command(recording: Path, view: str, output: Path, moment: float | None) -> None:
    """Render a picture or a film of the last run of RECORDING."""
    if output.suffix not in OUTPUT_SUFFIXES:
        raise ViewerError(f'--output {output}: must end in one of {", ".join(OUTPUT_SUFFIXES)}')
    if output.is_dir():
        raise ViewerError(f'--output {output}: is a folder; name a file')
    if moment is not None and output.suffix != '.png':
        raise ViewerError(f'--time requires a .png; {output.name} shows the whole run')
    require_viser()
    browser_program()
    # Imported only here: it takes half a second.
    from ballbot_ros.cli.recordings import read_playback_run

    run = read_playback_run(recording)
    if moment is not None and not moment <= run.end:  # also refuses NaN
        raise ViewerError(f'--time {moment:g}: the run ends at {run.end:g} s')
    # Imported only here: viser takes a second.
    with importing(), defer_sigint():
        from ballbot_ros.viewer.render import render_to_file
    with file_progress(output.name) as progress:
        render_to_file(run, view, output, run.end if moment is None else moment, progress)
    click.echo(f'picture  {output}')
