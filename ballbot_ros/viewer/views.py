"""The five views of the document (8.3) and their cameras."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ballbot_ros.parameters import Dimensions
from ballbot_ros.viewer.floor import Area
from ballbot_ros.viewer.robot import sonar_position
from ballbot_ros.viewer.rotations import body_rotation
from ballbot_ros.viewer.snapshot import Snapshot

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
