"""Orientations, and the five views of the document (8.3) with their cameras.

Recordings need the shape and the frames of the robot, but not these: importing scipy's rotations
takes a quarter of a second.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from ballbot_ros.parameters import Dimensions
from ballbot_ros.recording.messages.conversions import body_orientation
from ballbot_ros.robot.plant.ground_truth import Pair
from ballbot_ros.viewer.markers import Area
from ballbot_ros.viewer.robot import sonar_position, wheel_angles
from ballbot_ros.viewer.snapshot import Snapshot

_MARK_POINTS = 2500
"""Interval at which the orientation of the ball along a recorded path is stored: 10 s."""


def body_rotation(psi: Pair) -> Rotation:
    """Return the orientation of ``base_link`` in ``map`` for the pitch angles `psi` [rad]."""
    w, x, y, z = body_orientation(psi)
    return Rotation.from_quat((x, y, z, w))


def rolled(path: NDArray[np.float64], radius: float) -> Rotation:
    """Return the rotation of a ball that rolls along `path` without slip.

    The path has the position of the ball in both planes [m], shape (n, 2), and is straight between
    its points. Steps to and from a point that is not finite do not count.
    """
    steps = np.diff(path, axis=0)
    steps = steps[np.isfinite(steps).all(axis=1)]  # a foreign plant may publish any value
    # About +y along x; about +x along plane y, which is -y in ``map``.
    axes = np.column_stack([steps[:, 1], steps[:, 0], np.zeros(len(steps))])
    turns = Rotation.concatenate([Rotation.identity(1), Rotation.from_rotvec(axes / radius)])
    while len(turns) > 1:  # combine neighbours: the later one times the earlier one
        pairs = turns[1::2] * turns[: len(turns) // 2 * 2 : 2]
        turns = Rotation.concatenate([pairs, turns[-1:]]) if len(turns) % 2 else pairs
    return turns[0]


class RolledBall:
    """The orientation of the ball at each point of a known path, as in :func:`rolled`."""

    def __init__(self, path: NDArray[np.float64], radius: float) -> None:
        self._path = path
        self._radius = radius
        self._marks = [Rotation.identity()]  # every _MARK_POINTS points

    def at(self, point: int) -> Rotation:
        """Return the orientation at the point of this number."""
        while len(self._marks) <= point // _MARK_POINTS:
            self._marks.append(self._roll(len(self._marks) * _MARK_POINTS))
        return self._roll(point)

    def _roll(self, point: int) -> Rotation:
        mark = min(point // _MARK_POINTS, len(self._marks) - 1)
        path = self._path[mark * _MARK_POINTS : point + 1]
        return rolled(path, self._radius) * self._marks[mark]


class RollingOrientation:
    """Orientations of ball and wheels, integrated from the path of the ball.

    Without slip, position and pitch determine both: a wheel turns by k (θ − ψ), and the ball rolls
    along its path. An unknown path, as after a jump in time, counts as straight.
    """

    def __init__(self, dimensions: Dimensions) -> None:
        self._dimensions = dimensions
        self._from: Pair | None = None
        self._ball = Rotation.identity()

    def ball(self, position: Pair) -> Rotation:
        """Roll the ball to `position` [m]; return its orientation."""
        before, self._from = self._from or position, position
        path = np.array([before, position])
        self._ball = rolled(path, self._dimensions.ball_radius) * self._ball
        return self._ball

    def wheels(self, position: Pair, psi: Pair) -> tuple[Rotation, Rotation]:
        """Return the orientations of wheels x and y in ``base_link``."""
        x, y = wheel_angles(self._dimensions, position, psi)
        return Rotation.from_euler('y', x), Rotation.from_euler('x', y)


TOP, VISTA, CHASER_1, CHASER_2, ROBOT = VIEWS = ('top', 'vista', 'chaser1', 'chaser2', 'robot')

TITLES = {
    TOP: 'Top',
    VISTA: 'Vista',
    CHASER_1: 'Chaser 1 (left)',
    CHASER_2: 'Chaser 2 (front)',
    ROBOT: 'Robot (sonar)',
}
TRACKING = (CHASER_1, CHASER_2, ROBOT)
"""Views whose camera follows the robot; the others allow orbiting."""

_NARROW, _WIDE = math.radians(40.0), math.radians(70.0)
_UP = (0.0, 0.0, 1.0)
_CHASED_HEIGHT = 0.15
_CHASERS = {CHASER_1: (-0.16, 0.68, 0.24), CHASER_2: (0.70, 0.14, 0.24)}


class FreeView(NamedTuple):
    """A fixed camera: its position and the point that it looks at, in ``map`` [m]."""

    position: tuple[float, float, float]
    look_at: tuple[float, float, float]


View = str | FreeView
"""One of the five, or a fixed camera."""


class Camera(NamedTuple):
    """A camera in ``map`` [m]; `fov` is the vertical field of view [rad]."""

    position: tuple[float, float, float]
    look_at: tuple[float, float, float]
    up: tuple[float, float, float]
    fov: float


def camera(
    view: View, snapshot: Snapshot, dimensions: Dimensions, area: Area, aspect: float
) -> Camera:
    """Return the camera of a view for a picture with the aspect ratio `aspect` (width/height)."""
    if isinstance(view, FreeView):
        return _free_camera(view)
    x, y = area.middle
    if view == TOP:
        height = 1.08 * max(area.half_y, area.half_x / aspect) / math.tan(_NARROW / 2.0)
        return _free_camera(FreeView((x, y, height), (x, y, 0.0)))
    if view == VISTA:
        far = 1.16 * math.hypot(area.half_x, area.half_y) * max(1.16, 1.5 / aspect)
        away = (x - 0.95 * far, y - 1.0 * far, 1.05 * far)
        return Camera(away, (x, y, -0.10 * far), _UP, _NARROW)
    ball = np.array([snapshot.position[0], -snapshot.position[1], dimensions.ball_radius])
    if view == ROBOT:
        lens, ahead, up = body_rotation(snapshot.psi).apply(
            [sonar_position(dimensions), (1.0, 0.0, 0.0), _UP]
        )
        eye = ball + lens + 0.01 * ahead
        return Camera(_vector(eye), _vector(eye + ahead), _vector(up), _WIDE)
    target = ball + np.array([0.0, 0.0, _CHASED_HEIGHT])
    return Camera(_vector(target + _CHASERS[view]), _vector(target), _UP, _NARROW)


def _free_camera(view: FreeView) -> Camera:
    x, y, z = view.position
    if (x, y) == view.look_at[:2]:
        # Slightly from the south, so that +x is on the right, as in the map image.
        y -= 1e-3 * abs(z - view.look_at[2])
    return Camera((x, y, z), view.look_at, _UP, _NARROW)


def _vector(array: NDArray[np.float64]) -> tuple[float, float, float]:
    x, y, z = array.tolist()
    return x, y, z
