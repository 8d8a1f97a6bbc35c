"""The robot as a URDF document: links, joints and masses, from the table of parts."""

from __future__ import annotations

from collections.abc import Sequence
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

from ballbot_ros.parameters import Dimensions
from ballbot_ros.plant.model import Bodies
from ballbot_ros.viewer.colours import NAMES
from ballbot_ros.viewer.robot import (
    BALL,
    BODY,
    DECK_ABOVE_WHEEL,
    LINKS,
    WHEEL_X,
    WHEEL_Y,
    X_AXIS,
    Y_AXIS,
    Z_AXIS,
    Vector,
    parts,
    sonar_position,
    wheel_centres,
)
from ballbot_ros.viewer.transforms import SONAR

MOTOR_X, MOTOR_Y, BALL_JOINT, SONAR_JOINT = 'motor_x', 'motor_y', 'ball_joint', 'sonar_joint'
"""The joints; the first two are those of ``plant/joint_states`` and ``joint_states``."""

_ZERO = 1e-15
_ORIGIN: Vector = (0.0, 0.0, 0.0)


def robot_description(dimensions: Dimensions, bodies: Bodies) -> str:
    """Return the URDF document.

    ``base_link`` is the root. A floating joint attaches the ball, whose frame neither pitches nor
    rolls. Motor positions are positive in plane signs, so the axes are the negative y and x axes: a
    wheel turns against the ball.

    Parameters
    ----------
    dimensions : Dimensions
    bodies : Bodies
        Masses, and the moments of inertia that the model has.

    Returns
    -------
    str
        XML; equal parameters give equal text.
    """
    robot = Element('robot', name='ballbot')
    for colour, name in NAMES.items():
        material = SubElement(robot, 'material', name=name)
        rgba = (*(channel / 255.0 for channel in colour), 1.0)
        SubElement(material, 'color', rgba=_text(rgba))
    links = {name: SubElement(robot, 'link', name=name) for name in (*LINKS, SONAR)}
    _add_inertials(links, dimensions, bodies)
    for part in parts(dimensions):
        visual = SubElement(links[part.link], 'visual')
        _add_shape(visual, part.shape, part.size, part.position, part.rpy)
        SubElement(visual, 'material', name=NAMES[part.colour])
    _add_collisions(links, dimensions)
    centres = wheel_centres(dimensions)
    _add_joint(robot, BALL_JOINT, 'floating', BALL, _ORIGIN)
    _add_joint(robot, MOTOR_X, 'continuous', WHEEL_X, centres[0], (0.0, -1.0, 0.0))
    _add_joint(robot, MOTOR_Y, 'continuous', WHEEL_Y, centres[1], (-1.0, 0.0, 0.0))
    _add_joint(robot, SONAR_JOINT, 'fixed', SONAR, sonar_position(dimensions))
    ElementTree.indent(robot)
    return ElementTree.tostring(robot, 'unicode') + '\n'


def _add_inertials(links: dict[str, Element], dimensions: Dimensions, bodies: Bodies) -> None:
    """Add masses and inertias: those of the model, and the rest from the shape."""
    ball, body, axle = bodies.ball_inertia, bodies.body_inertia, bodies.wheel_inertia
    # The model has no yaw inertia: use a box with the body's outline.
    yaw = bodies.body_mass * (dimensions.body_depth**2 + dimensions.body_width**2) / 12.0
    # The model turns a wheel only about its axle: use a cylinder.
    across = bodies.wheel_mass * (3.0 * bodies.wheel_radius**2 + bodies.wheel_width**2) / 12.0
    middle = (0.0, 0.0, bodies.body_height)
    for link, mass, centre, moments in (
        (BALL, bodies.ball_mass, _ORIGIN, (ball, ball, ball)),
        (BODY, bodies.body_mass, middle, (body, body, yaw)),
        (WHEEL_X, bodies.wheel_mass, _ORIGIN, (across, axle, across)),
        (WHEEL_Y, bodies.wheel_mass, _ORIGIN, (axle, across, across)),
    ):
        inertial = SubElement(links[link], 'inertial')
        SubElement(inertial, 'origin', xyz=_text(centre), rpy=_text(Z_AXIS))
        SubElement(inertial, 'mass', value=_text((mass,)))
        terms = dict(zip(('ixx', 'iyy', 'izz'), (_text((each,)) for each in moments), strict=True))
        SubElement(inertial, 'inertia', terms, ixy='0', ixz='0', iyz='0')


def _add_collisions(links: dict[str, Element], dimensions: Dimensions) -> None:
    """Add the ball, the tires and, above the deck, a box with the body's outline."""
    tire = (dimensions.wheel_radius, dimensions.wheel_width)
    deck = dimensions.wheel_radius + DECK_ABOVE_WHEEL
    height = 2.0 * dimensions.body_height - deck
    box = (dimensions.body_depth, dimensions.body_width, height)
    for link, shape, size, centre, rpy in (
        (BALL, 'sphere', (dimensions.ball_radius,), _ORIGIN, Z_AXIS),
        (WHEEL_X, 'cylinder', tire, _ORIGIN, Y_AXIS),
        (WHEEL_Y, 'cylinder', tire, _ORIGIN, X_AXIS),
        (BODY, 'box', box, (0.0, 0.0, deck + height / 2.0), Z_AXIS),
    ):
        if min(size) > 0.0:
            _add_shape(SubElement(links[link], 'collision'), shape, size, centre, rpy)


def _add_shape(
    parent: Element, shape: str, size: Sequence[float], position: Vector, rpy: Vector
) -> None:
    SubElement(parent, 'origin', xyz=_text(position), rpy=_text(rpy))
    geometry = SubElement(parent, 'geometry')
    if shape == 'box':
        SubElement(geometry, 'box', size=_text(size))
    else:
        names = ('radius', 'length')[: len(size)]
        numbers = (_text((length,)) for length in size)
        SubElement(geometry, shape, dict(zip(names, numbers, strict=True)))


def _add_joint(
    robot: Element, name: str, kind: str, child: str, origin: Vector, axis: Vector | None = None
) -> None:
    joint = SubElement(robot, 'joint', name=name, type=kind)
    SubElement(joint, 'parent', link=BODY)
    SubElement(joint, 'child', link=child)
    SubElement(joint, 'origin', xyz=_text(origin), rpy=_text(Z_AXIS))
    if axis:
        SubElement(joint, 'axis', xyz=_text(axis))


def _text(numbers: Sequence[float]) -> str:
    """Format numbers for URDF, without the rounding errors of zeros."""
    return ' '.join(f'{number if abs(number) > _ZERO else 0.0:.9g}' for number in numbers)
