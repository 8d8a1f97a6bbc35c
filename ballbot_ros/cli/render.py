"""`ballbot render`: pictures and films of recorded runs."""

from __future__ import annotations

import math
import re
from pathlib import Path

import click

from ballbot_ros.cli.options import NEW_FILE, RECORDING, FloatRange
from ballbot_ros.cli.progress import file_progress
from ballbot_ros.errors import ViewerError, did_you_mean, importing
from ballbot_ros.parameters.timing import TICK_S
from ballbot_ros.process import DeferredSignals
from ballbot_ros.viewer.address import require_viser
from ballbot_ros.viewer.browser import browser_program
from ballbot_ros.viewer.views import CHASER_1, VIEWS, FreeView, View

MIN_SIDE, MAX_SIDE = 64, 4096
"""Smallest and largest side of a picture [px]."""

Point = tuple[float, float, float]


def _parse_size(context: click.Context, parameter: click.Parameter, value: str) -> tuple[int, int]:
    """Return width and height [px]."""
    found = re.fullmatch(r'(\d{1,9})x(\d{1,9})', value)
    if not found:
        raise click.BadParameter(f'{value!r} is not a width and a height, such as 960x528')
    width, height = int(found[1]), int(found[2])
    if not all(MIN_SIDE <= side <= MAX_SIDE for side in (width, height)):
        raise click.BadParameter(f'{value}: each side must have {MIN_SIDE} to {MAX_SIDE} pixels')
    return width, height


def parse_view(context: click.Context, parameter: click.Parameter, value: str) -> View:
    """Return the name of a view, or a fixed camera."""
    if value in VIEWS:
        return value
    points = [_point(text) for text in value.split(':')]
    if len(points) != 2 or None in points:
        raise click.BadParameter(
            f'{value!r} is neither one of {", ".join(VIEWS)} nor a camera and the point it looks '
            f'at, x,y,z:x,y,z in map [m], such as 1,-1,0.5:0,0,0.1{did_you_mean(value, VIEWS)}'
        )
    position, look_at = filter(None, points)
    if position == look_at:
        raise click.BadParameter(f'{value}: the camera must not be where it looks')
    return FreeView(position, look_at)


def _point(text: str) -> Point | None:
    """Return three finite numbers; None if the text is something else."""
    try:
        x, y, z = map(float, text.split(','))
    except ValueError:
        return None
    return (x, y, z) if math.isfinite(x + y + z) else None


PICTURE = '.png'
FILM_FPS = {'.mp4': 20, '.webp': 20, '.gif': 10}
"""Default frames per second of each format."""


@click.command('render')
@click.argument('recording', type=RECORDING)
@click.argument('other', required=False, type=RECORDING)
@click.option(
    '--output',
    required=True,
    type=NEW_FILE,
    help='File to write or replace: a picture (.png) or a film (.mp4, .webp, .gif).',
)
@click.option(
    '--view',
    metavar='VIEW',
    default=CHASER_1,
    show_default=True,
    callback=parse_view,
    help=f'The view: {", ".join(VIEWS)}, or a fixed camera and the point it looks at, '
    'x,y,z:x,y,z in map [m].',
)
@click.option(
    '--time',
    'moment',
    type=FloatRange(0.0),
    help='Time of a picture from the start of the run [s].  [default: the end]',
)
@click.option('--start', type=FloatRange(0.0), help='Start of a film [s].  [default: the start]')
@click.option('--end', type=FloatRange(0.0), help='End of a film [s].  [default: the end]')
@click.option(
    '--rate',
    type=FloatRange(0.01, 100.0),
    help='Seconds of the run per second of the film; 0.25 is slow motion.  [default: 1]',
)
@click.option(
    '--fps',
    type=click.IntRange(1, 60),
    help='Frames per second of a film.  [default: 20, .gif: 10]',
)
@click.option(
    '--size',
    metavar='WxH',
    default='960x528',
    show_default=True,
    callback=_parse_size,
    help='Width and height [px].',
)
@click.option('--time-stamp', is_flag=True, help='Write the time into the picture.')
def command(
    recording: Path,
    other: Path | None,
    output: Path,
    view: View,
    moment: float | None,
    start: float | None,
    end: float | None,
    rate: float | None,
    fps: int | None,
    size: tuple[int, int],
    time_stamp: bool,
) -> None:
    """Render a picture or a film of the last run of RECORDING, with that of OTHER as its ghost."""
    film_options = {'--start': start, '--end': end, '--rate': rate, '--fps': fps}
    _check_output(output, moment, [name for name, each in film_options.items() if each is not None])
    require_viser()
    browser_program()
    # Imported only here: viser takes a second.
    with importing('film'), DeferredSignals():
        from ballbot_ros.cli.recordings import read_playback_runs
        from ballbot_ros.viewer.render import Rendering, frame_times

    _check_format(output, fps, size)
    run, *ghosts = read_playback_runs(recording, other)
    ghost = ghosts[0] if ghosts else None
    run_end = max(run.end, ghost.end if ghost else 0.0)
    rendering = Rendering(run, view, ghost, size, time_stamp)
    if output.suffix == PICTURE:
        rendering.write_picture(output, _time_within('--time', moment, run_end, run_end))
        click.echo(f'picture  {output}')
        return
    fps = fps or FILM_FPS[output.suffix]
    first, last = _excerpt(start, end, run_end)
    with file_progress(output.name, 'frames') as progress:
        rendering.write_film(output, frame_times(first, last, fps, rate or 1.0), fps, progress)
    click.echo(f'film  {output}')


def _check_output(output: Path, moment: float | None, film_options: list[str]) -> None:
    suffixes = (PICTURE, *FILM_FPS)
    if output.suffix not in suffixes:
        raise ViewerError(f'--output {output}: must end in one of {", ".join(suffixes)}')
    if output.is_dir():
        raise ViewerError(f'--output {output}: is a folder; name a file')
    if output.suffix == PICTURE and film_options:
        raise ViewerError(f'{film_options[0]} requires a film; {output.name} is a picture')
    if output.suffix != PICTURE and moment is not None:
        raise ViewerError(f'--time requires a .png; for {output.name} use --start and --end')


def _check_format(output: Path, fps: int | None, size: tuple[int, int]) -> None:
    from ballbot_ros.viewer.render import FORMATS

    film_format = FORMATS.get(output.suffix)
    if film_format is None:
        return
    if fps is not None and fps > film_format.max_fps:
        raise ViewerError(f'--fps {fps}: a {output.suffix} has at most {film_format.max_fps}')
    if film_format.needs_even_size and any(side % 2 for side in size):
        width, height = size
        raise ViewerError(
            f'--size {width}x{height}: width and height of a {output.suffix} must be even'
        )


def _excerpt(start: float | None, end: float | None, run_end: float) -> tuple[float, float]:
    first = _time_within('--start', start, run_end, 0.0)
    last = _time_within('--end', end, run_end, run_end)
    if not first < last:
        raise ViewerError(f'--start {first:g}: must be before the end of the film at {last:g} s')
    return first, last


def _time_within(option: str, time: float | None, run_end: float, default: float) -> float:
    if time is None:
        return default
    if not time <= run_end + TICK_S:  # also refuses NaN
        raise ViewerError(f'{option} {time:g}: the run ends at {run_end:g} s')
    return time
