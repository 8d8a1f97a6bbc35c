"""The robot as a URDF document: ``config/urdf`` has its links and joints, which this fills in."""

from __future__ import annotations

from functools import cache

from jinja2 import Environment, FileSystemLoader, StrictUndefined, Template

from ballbot_ros.parameters import Dimensions
from ballbot_ros.plant.model import Bodies
from ballbot_ros.share import share_directory
from ballbot_ros.viewer.colours import DARK, NAMES
from ballbot_ros.viewer.robot import (
    BODY,
    DECK_ABOVE_WHEEL,
    Z_AXIS,
    Part,
    parts,
    sonar_position,
    wheel_centres,
)

_ZERO = 1e-15


def robot_description(dimensions: Dimensions, bodies: Bodies) -> str:
    """Return the URDF document; equal parameters give equal text."""
    deck = dimensions.wheel_radius + DECK_ABOVE_WHEEL
    height = 2.0 * dimensions.body_height - deck
    depth, width = dimensions.body_depth, dimensions.body_width
    body = Part(BODY, 'box', (depth, width, height), (0.0, 0.0, deck + height / 2.0), Z_AXIS, DARK)
    visible = list(parts(dimensions))
    # Ball and tires are the first part of their links.
    collisions = {part.link: part for part in reversed(visible) if part.link != BODY}
    if min(body.size) > 0.0:
        collisions[BODY] = body
    wheel_x, wheel_y = wheel_centres(dimensions)
    return _template().render(
        text=_text,
        colours=NAMES,
        bodies=bodies,
        # The model has no yaw inertia: use a box with the body's outline.
        yaw_inertia=bodies.body_mass * (depth**2 + width**2) / 12.0,
        # The model turns a wheel only about its axle: use a cylinder.
        across=bodies.wheel_mass * (3.0 * bodies.wheel_radius**2 + bodies.wheel_width**2) / 12.0,
        parts=visible,
        collisions=collisions,
        wheel_x=wheel_x,
        wheel_y=wheel_y,
        sonar=sonar_position(dimensions),
    )


@cache
def _template() -> Template:
    environment = Environment(
        loader=FileSystemLoader(share_directory() / 'config' / 'urdf'),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    return environment.get_template('ballbot.urdf.jinja')


def _text(*numbers: float) -> str:
    """Format numbers for URDF, without the rounding errors of zeros."""
    return ' '.join(f'{number if abs(number) > _ZERO else 0.0:.9g}' for number in numbers)
