"""Options that describe a picture."""

from __future__ import annotations

import math
import re

import click

from ballbot_ros.suggestions import did_you_mean
from ballbot_ros.viewer.views import CHASER_1, VIEWS, FreeView, View

MIN_SIDE, MAX_SIDE = 64, 4096
"""Smallest and largest side of a picture [px]."""

Point = tuple[float, float, float]


def parse_size(context: click.Context, parameter: click.Parameter, value: str) -> tuple[int, int]:
    """Return width and height [px]."""
    found = re.fullmatch(r'(\d{1,9})x(\d{1,9})', value)
    if not found:
        raise click.BadParameter(
            f'{value!r} is not a width and a height, such as 960x528', context, parameter
        )
    width, height = int(found[1]), int(found[2])
    if not all(MIN_SIDE <= side <= MAX_SIDE for side in (width, height)):
        raise click.BadParameter(
            f'{value}: each side must have {MIN_SIDE} to {MAX_SIDE} pixels', context, parameter
        )
    return width, height


def parse_view(context: click.Context, parameter: click.Parameter, value: str) -> View:
    """Return the name of a view, or a fixed camera."""
    if value in VIEWS:
        return value
    points = [_point(text) for text in value.split(':')]
    if len(points) != 2 or None in points:
        raise click.BadParameter(
            f'{value!r} is neither one of {", ".join(VIEWS)} nor a camera and the point it looks '
            f'at, x,y,z:x,y,z in map [m], such as 1,-1,0.5:0,0,0.1{did_you_mean(value, VIEWS)}',
            context,
            parameter,
        )
    position, look_at = filter(None, points)
    if position == look_at:
        raise click.BadParameter(
            f'{value}: the camera must not be where it looks', context, parameter
        )
    return FreeView(position, look_at)


def _point(text: str) -> Point | None:
    """Return three finite numbers; None if the text is something else."""
    try:
        x, y, z = map(float, text.split(','))
    except ValueError:
        return None
    return (x, y, z) if math.isfinite(x + y + z) else None


view_option = click.option(
    '--view',
    metavar='VIEW',
    default=CHASER_1,
    show_default=True,
    callback=parse_view,
    help=f'The view: {", ".join(VIEWS)}, or a fixed camera and the point it looks at, '
    'x,y,z:x,y,z in map [m].',
)
"""Selects the camera."""

size_option = click.option(
    '--size',
    metavar='WxH',
    default='960x528',
    show_default=True,
    callback=parse_size,
    help='Width and height [px].',
)
"""Selects the size of a picture."""
