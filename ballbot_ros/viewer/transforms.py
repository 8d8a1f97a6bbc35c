"""The frame tree and all poses in it, shared by URDF, transforms and markers."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from ballbot_ros.parameters import Dimensions
from ballbot_ros.plant.ground_truth import Pair
from ballbot_ros.viewer.robot import (
    BALL,
    BODY,
    WHEEL_X,
    WHEEL_Y,
    RollingOrientation,
    body_rotation,
    sonar_position,
    wheel_centres,
    wxyz,
)

MAP, SONAR = 'map', 'sonar'

PARENTS = {BODY: MAP, BALL: BODY, WHEEL_X: BODY, WHEEL_Y: BODY, SONAR: BODY}
"""The parent of each frame."""

MOVING = (BODY, BALL, WHEEL_X, WHEEL_Y)
"""The frames that move in their parents; the others are fixed."""


class Transform(NamedTuple):
    """The pose of a frame in another one, or the poses of many objects.

    The position [m] has the shape (3,) or (n, 3); the rotation is one, or n.
    """

    position: NDArray[np.float64]
    rotation: Rotation

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

    ``base_link`` and ``ball`` have their origin in the ball's centre. The axes of ``ball`` stay
    parallel to those of ``map`` (docs/frames.md), so in ``base_link`` it rotates opposite to the
    pitch.
    """

    def __init__(self, dimensions: Dimensions) -> None:
        self._orientation = RollingOrientation(dimensions)
        self._height = dimensions.ball_radius
        centres = wheel_centres(dimensions)
        self._origins = {
            BALL: np.zeros(3),
            WHEEL_X: np.array(centres[0]),
            WHEEL_Y: np.array(centres[1]),
            SONAR: np.array(sonar_position(dimensions)),
        }

    def at(self, position: Pair, psi: Pair) -> dict[str, Transform]:
        """Return the pose of every frame in its parent for the ball's position [m] and pitch [rad].

        Both are in plane signs.
        """
        body = body_rotation(psi)
        wheel_x, wheel_y = self._orientation.wheels(position, psi)
        rotations = {
            BALL: body.inv(),
            WHEEL_X: wheel_x,
            WHEEL_Y: wheel_y,
            SONAR: Rotation.identity(),
        }
        centre = np.array([position[0], -position[1], self._height])
        return {BODY: Transform(centre, body)} | {
            frame: Transform(self._origins[frame], rotation)
            for frame, rotation in rotations.items()
        }


def poses_in_map(frames: dict[str, Transform]) -> dict[str, Transform]:
    """Return every frame of :meth:`Frames.at` in ``map``."""
    body = frames[BODY]
    return {frame: pose if frame == BODY else body.compose(pose) for frame, pose in frames.items()}
