"""The robot's shape, derived from its physical parameters, and its frame tree.

The parts are boxes, cylinders and spheres in one table, from which both the scene and the URDF are
built. Lengths are in metres, in the axes of the link (REP 103, docs/frames.md). The contact of
wheels and ball is schematic, as in the figure there.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ballbot_ros.parameters import Dimensions
from ballbot_ros.recording.messages.conversions import body_orientation
from ballbot_ros.recording.messages.tool_messages import FOOTPRINT, ODOM_FRAME, FramePose
from ballbot_ros.robot.plant.ground_truth import Pair

if TYPE_CHECKING:
    from scipy.spatial.transform import Rotation

Colour = tuple[int, int, int]
"""Red, green, blue, 0 ... 255."""

LIGHT, DARK, ORANGE, BLACK, BLUE, WHITE = (
    (214, 217, 220), (92, 98, 106), (238, 122, 40), (38, 41, 46), (44, 116, 190), (246, 247, 248),
)  # fmt: skip

NAMES: dict[Colour, str] = {
    LIGHT: 'light', DARK: 'dark', ORANGE: 'orange', BLACK: 'black', BLUE: 'blue', WHITE: 'white',
}  # fmt: skip
"""The colours of the robot's parts by name."""

FLOOR, WALL, LINE = (236, 233, 226), (148, 158, 170), (40, 42, 46)

ZENITH, HORIZON = (188, 204, 222), (242, 245, 248)

TRAIL, GHOST_TRAIL, GHOST = (238, 122, 40), (110, 120, 200), (120, 135, 220)

GHOST_LIGHT = (176, 186, 238)
"""The curve of plane y of the ghost; that of plane x has the colour of the ghost."""

FORCE = (44, 116, 190)

BEAM, BEAM_OPACITY = (255, 160, 60), 0.22

HEADING, HEADING_OPACITY = DARK, 0.45


Vector = tuple[float, float, float]

BALL, BODY, WHEEL_X, WHEEL_Y = 'ball', 'base_link', 'wheel_x', 'wheel_y'
LINKS = (BALL, BODY, WHEEL_X, WHEEL_Y)

X_AXIS: Vector = (0.0, math.pi / 2.0, 0.0)
Y_AXIS: Vector = (math.pi / 2.0, 0.0, 0.0)
Z_AXIS: Vector = (0.0, 0.0, 0.0)

SONAR_HEIGHT = 0.085
"""Height of the sonar above the ball's centre [m]: below the top of the walls."""

DECK_ABOVE_WHEEL = 0.014
"""Height of the deck's centre above the wheels [m]."""

LCD_SIZE = (0.058, 0.046)
"""Width and height of the brick's display [m]."""

TRAIL_STEP = 0.01
"""Minimum step between points of the ball's trail [m]."""

CONE_ANGLES = (math.radians(1.0), 3.0)
"""Smallest opening of the sonar's cone as drawn, also for a single ray, and largest one [rad]."""


class Part(NamedTuple):
    """A primitive of a link.

    Attributes
    ----------
    shape : str
        'box', 'cylinder' (along z) or 'sphere'.
    size : tuple of float
        Sides of a box; radius and length of a cylinder; radius of a sphere.
    position : tuple of float
        Position of its centre in the link.
    rpy : tuple of float
        Roll, pitch and yaw in the link, as in URDF [rad].
    """

    link: str
    shape: str
    size: tuple[float, ...]
    position: Vector
    rpy: Vector
    colour: Colour


def wheel_centres(dimensions: Dimensions) -> tuple[Vector, Vector]:
    """Return the centres of wheels x (behind the ball) and y (on its right) in ``base_link``."""
    reach = dimensions.ball_radius + dimensions.wheel_radius
    return (-reach, 0.0, 0.0), (0.0, -reach, 0.0)


def sonar_position(dimensions: Dimensions) -> Vector:
    """Return the position of the frame ``sonar`` in ``base_link``: at the front face."""
    return dimensions.body_depth / 2.0, 0.0, SONAR_HEIGHT


def lcd_position(dimensions: Dimensions) -> Vector:
    """Return the centre of the display in ``base_link``; it faces forward."""
    return _brick_centre(dimensions)[0] + 0.0252, 0.0, _brick_centre(dimensions)[2] + 0.022


def grip(dimensions: Dimensions, direction: tuple[float, float]) -> Vector:
    """Return where a horizontal line from the body's centre leaves the body, in ``base_link``."""
    sides = dimensions.body_depth / 2.0, dimensions.body_width / 2.0
    reach = min(side / abs(part) for side, part in zip(sides, direction, strict=True) if part)
    x, y = direction
    return reach * x, reach * y, dimensions.body_height


def _brick_centre(dimensions: Dimensions) -> Vector:
    return 0.0, 0.0, 2.0 * dimensions.body_height - 0.095


def parts(dimensions: Dimensions) -> Iterator[Part]:
    """Iterate over all parts of the robot for which its dimensions leave room."""
    return (part for part in _parts(dimensions) if min(part.size) > 0.0)


def _parts(dimensions: Dimensions) -> Iterator[Part]:
    radius, width = dimensions.wheel_radius, dimensions.wheel_width
    yield Part(BALL, 'sphere', (dimensions.ball_radius,), (0.0, 0.0, 0.0), Z_AXIS, BLUE)
    for link, axis in ((WHEEL_X, Y_AXIS), (WHEEL_Y, X_AXIS)):
        yield Part(link, 'cylinder', (radius, width), (0.0, 0.0, 0.0), axis, BLACK)
        yield Part(link, 'cylinder', (0.62 * radius, 1.08 * width), (0.0, 0.0, 0.0), axis, LIGHT)
        for quarter in range(4):  # spokes make the rotation visible
            angle = quarter * math.pi / 2.0
            side, up = 0.38 * radius * math.cos(angle), 0.38 * radius * math.sin(angle)
            at = (side, 0.0, up) if link == WHEEL_X else (0.0, side, up)
            yield Part(link, 'cylinder', (0.14 * radius, 1.14 * width), at, axis, DARK)
    yield from _body(dimensions)


def _body(dimensions: Dimensions) -> Iterator[Part]:
    depth, breadth = dimensions.body_depth, dimensions.body_width
    radius, width = dimensions.wheel_radius, dimensions.wheel_width

    def box(size: Vector, at: Vector, colour: Colour, rpy: Vector = Z_AXIS) -> Part:
        return Part(BODY, 'box', size, at, rpy, colour)

    def rod(size: Pair, at: Vector, axis: Vector, colour: Colour) -> Part:
        return Part(BODY, 'cylinder', size, at, axis, colour)

    deck = radius + DECK_ABOVE_WHEEL
    ceiling = _brick_centre(dimensions)[2] - 0.07
    # The idler presses the ball against both driven wheels.
    idler = (dimensions.ball_radius + 0.5 * radius) / math.sqrt(2.0)
    yield Part(
        BODY, 'cylinder', (0.5 * radius, 0.7 * width), (idler, idler, 0.0),
        (math.pi / 2.0, 0.0, -math.pi / 4.0), DARK,
    )  # fmt: skip
    yield box((0.012, 0.012, deck), (idler + 0.014, idler + 0.014, deck / 2.0), LIGHT)
    # Two motors next to their wheels, orange at the shaft.
    (wheel_x, _, _), (_, wheel_y, _) = wheel_centres(dimensions)
    side = width / 2.0 + 0.006
    yield rod((0.012, 0.010), (wheel_x, side, 0.0), Y_AXIS, ORANGE)
    yield box((0.026, 0.020, 0.044), (wheel_x, side + 0.014, 0.012), LIGHT)
    yield rod((0.012, 0.010), (side, wheel_y, 0.0), X_AXIS, ORANGE)
    yield box((0.020, 0.026, 0.044), (side + 0.014, wheel_y, 0.012), LIGHT)
    # Deck, corner posts, and the plate under the brick.
    yield box((depth, breadth, 0.008), (0.0, 0.0, deck), DARK)
    for x in (-1.0, 1.0):
        for y in (-1.0, 1.0):
            at = (x * (depth / 2.0 - 0.008), y * (breadth / 2.0 - 0.008))
            yield box((0.012, 0.012, ceiling - deck), (*at, (ceiling + deck) / 2.0), LIGHT)
            yield rod((0.0045, 0.0135), (*at, deck + 0.03), Y_AXIS, DARK)
            yield rod((0.0045, 0.0135), (*at, ceiling - 0.03), Y_AXIS, DARK)
    yield box((depth, breadth, 0.008), (0.0, 0.0, ceiling), DARK)
    # The two gyros stand on the deck.
    yield box((0.036, 0.022, 0.020), (0.02, 0.04, deck + 0.016), BLACK)
    yield box((0.022, 0.036, 0.020), (-0.04, -0.02, deck + 0.016), BLACK)
    yield from _sonar(dimensions)
    yield from _brick(dimensions)


def _sonar(dimensions: Dimensions) -> Iterator[Part]:
    x, _, z = sonar_position(dimensions)
    yield Part(BODY, 'box', (0.02, 0.012, 0.05), (x - 0.026, 0.0, z), Z_AXIS, DARK)
    yield Part(BODY, 'box', (0.024, 0.066, 0.030), (x - 0.018, 0.0, z), Z_AXIS, LIGHT)
    for y in (-0.02, 0.02):
        at = (x - 0.006, y, z)
        yield Part(BODY, 'cylinder', (0.0135, 0.018), at, X_AXIS, ORANGE)
        yield Part(BODY, 'cylinder', (0.0110, 0.020), at, X_AXIS, BLACK)


def _brick(dimensions: Dimensions) -> Iterator[Part]:
    x, y, z = _brick_centre(dimensions)
    front = x + 0.0235
    yield Part(BODY, 'box', (0.046, 0.074, 0.114), (x, y, z), Z_AXIS, WHITE)
    yield Part(BODY, 'box', (0.030, 0.076, 0.116), (x - 0.012, y, z), Z_AXIS, DARK)
    yield Part(BODY, 'box', (0.002, 0.066, 0.054), (front, y, z + 0.022), Z_AXIS, DARK)
    for at, colour, size in (
        ((front, y, z - 0.022), ORANGE, (0.006, 0.016, 0.016)),
        ((front, y + 0.020, z - 0.022), LIGHT, (0.006, 0.014, 0.012)),
        ((front, y - 0.020, z - 0.022), LIGHT, (0.006, 0.014, 0.012)),
        ((front, y, z - 0.042), DARK, (0.006, 0.026, 0.010)),
    ):
        yield Part(BODY, 'box', size, at, Z_AXIS, colour)


def cone_slope(cone_angle: float) -> float:
    """Return the ratio of radius to length at which to draw a sonar cone of this opening [rad].

    The opening is limited to :data:`CONE_ANGLES`, because a node other than ``sonar_driver`` may
    publish any value; NaN is drawn as a single ray.
    """
    smallest, largest = CONE_ANGLES
    # max() returns its first argument unless the second is larger, which a NaN never is.
    return math.tan(min(largest, max(smallest, cone_angle)) / 2.0)


def wheel_angles(dimensions: Dimensions, position: Pair, psi: Pair) -> Pair:
    """Return the rotations of wheel x about y, and of wheel y about x, of ``base_link`` [rad].

    The wheels touch the ball at its equator, so they turn against it. Arguments are in plane signs.
    """
    ratio = dimensions.ball_radius / dimensions.wheel_radius
    x, y = (
        -ratio * (coordinate / dimensions.ball_radius - pitch)
        for coordinate, pitch in zip(position, psi, strict=True)
    )
    return x, y


MAP, SONAR = 'map', 'sonar'

PARENTS = {
    ODOM_FRAME: MAP, FOOTPRINT: ODOM_FRAME, BODY: FOOTPRINT,
    BALL: BODY, WHEEL_X: BODY, WHEEL_Y: BODY, SONAR: BODY,
}  # fmt: skip
"""The parent of each frame, parents first."""

MOVING = (ODOM_FRAME, FOOTPRINT, BODY, BALL, WHEEL_X, WHEEL_Y)
"""The frames that move in their parents; the others are fixed."""


_LEVEL = 1.0, 0.0, 0.0, 0.0
"""The axes of the parent."""


def wxyz(rotation: Rotation) -> NDArray[np.float64]:
    """Return unit quaternions w, x, y, z, as messages and viser have them; shape (4,) or (n, 4)."""
    return np.roll(rotation.as_quat(), 1, axis=-1)


class Transform(NamedTuple):
    """The pose of a frame in another one, or the poses of many objects.

    The position [m] has the shape (3,) or (n, 3); the rotation is one, or n.
    """

    position: NDArray[np.float64]
    rotation: Rotation

    @classmethod
    def of(cls, pose: FramePose) -> Transform:
        """Return a pose as a transform."""
        from scipy.spatial.transform import Rotation

        return cls(np.array(pose.position), Rotation.from_quat(np.roll(pose.rotation, -1)))

    def compose(self, child: Transform) -> Transform:
        """Return the pose in the outer frame of an object at `child` in this frame."""
        return Transform(
            self.position + self.rotation.apply(child.position), self.rotation * child.rotation
        )

    def values(self) -> tuple[list[Any], list[Any]]:
        """Return position and quaternion w, x, y, z in the form that messages take."""
        return self.position.tolist(), wxyz(self.rotation).tolist()


class Frames:
    """Poses of the frames in their parents.

    ``odom`` is where the robot's own odometry began: it moves in ``map`` by the odometry's error.
    ``base_footprint`` is the ball's point of contact with the floor, level. ``base_link`` and
    ``ball`` have their origin in the ball's centre. The axes of ``ball`` stay parallel to those of
    ``map`` (docs/frames.md), so in ``base_link`` it rotates opposite to the pitch.
    """

    def __init__(self, dimensions: Dimensions) -> None:
        self._dimensions = dimensions
        self._wheel_x, self._wheel_y = wheel_centres(dimensions)
        self.fixed = {SONAR: FramePose(sonar_position(dimensions), _LEVEL)}

    def moving(self, position: Any, psi: Any, odometry: Any) -> dict[str, FramePose]:
        """Return the pose of each moving frame in its parent.

        `odometry` is how far the ball has rolled from the start, as the robot measures it [m]; the
        other arguments are those of :meth:`at`. The numbers may be columns.
        """
        odom_x, odom_y = odometry
        w, x, y, z = body_orientation(psi)
        angles = wheel_angles(self._dimensions, position, psi)
        (sin_x, cos_x), (sin_y, cos_y) = (_sine_cosine(angle / 2.0) for angle in angles)
        return {
            ODOM_FRAME: FramePose((position[0] - odom_x, odom_y - position[1], 0.0), _LEVEL),
            FOOTPRINT: FramePose((odom_x, -odom_y, 0.0), _LEVEL),
            BODY: FramePose((0.0, 0.0, self._dimensions.ball_radius), (w, x, y, z)),
            BALL: FramePose((0.0, 0.0, 0.0), (w, -x, -y, -z)),
            WHEEL_X: FramePose(self._wheel_x, (cos_x, 0.0, sin_x, 0.0)),
            WHEEL_Y: FramePose(self._wheel_y, (cos_y, sin_y, 0.0, 0.0)),
        }

    def at(self, position: Pair, psi: Pair) -> dict[str, Transform]:
        """Return the pose of every frame in its parent for the ball's position [m] and pitch [rad].

        Both are in plane signs. The odometry is that of a robot without errors.
        """
        poses = self.moving(position, psi, position) | self.fixed
        return {frame: Transform.of(pose) for frame, pose in poses.items()}


def _sine_cosine(angle: Any) -> tuple[Any, Any]:
    """Return sine and cosine [rad], also of each in a column, with the same bits."""
    if isinstance(angle, np.ndarray):
        angles = angle.tolist()
        return np.array(list(map(math.sin, angles))), np.array(list(map(math.cos, angles)))
    return math.sin(angle), math.cos(angle)


def poses_in_map(frames: dict[str, Transform]) -> dict[str, Transform]:
    """Return every frame of :meth:`Frames.at` in ``map``."""
    poses: dict[str, Transform] = {}
    for frame, parent in PARENTS.items():
        pose = frames[frame]
        poses[frame] = pose if parent == MAP else poses[parent].compose(pose)
    return poses
