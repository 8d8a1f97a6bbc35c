"""The frame tree and all poses in it, shared by URDF, transforms and markers."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from ballbot_ros.messages.conversions import body_orientation
from ballbot_ros.messages.transforms import Pose
from ballbot_ros.parameters import Dimensions
from ballbot_ros.plant.ground_truth import Pair
from ballbot_ros.viewer.robot import (
    BALL,
    BODY,
    WHEEL_X,
    WHEEL_Y,
    sonar_position,
    wheel_angles,
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

    @classmethod
    def of(cls, pose: Pose) -> Transform:
        """Return a pose as a transform."""
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

    ``base_link`` and ``ball`` have their origin in the ball's centre. The axes of ``ball`` stay
    parallel to those of ``map`` (docs/frames.md), so in ``base_link`` it rotates opposite to the
    pitch.
    """

    def __init__(self, dimensions: Dimensions) -> None:
        self._dimensions = dimensions
        self._wheel_x, self._wheel_y = wheel_centres(dimensions)
        self.fixed = {SONAR: Pose(sonar_position(dimensions), (1.0, 0.0, 0.0, 0.0))}

    def moving(self, position: Pair, psi: Pair) -> dict[str, Pose]:
        """Return the pose of each moving frame in its parent; arguments as in :meth:`at`."""
        centre = position[0], -position[1], self._dimensions.ball_radius
        w, x, y, z = body_orientation(psi)
        half_x, half_y = (a / 2.0 for a in wheel_angles(self._dimensions, position, psi))
        return {
            BODY: Pose(centre, (w, x, y, z)),
            BALL: Pose((0.0, 0.0, 0.0), (w, -x, -y, -z)),
            WHEEL_X: Pose(self._wheel_x, (math.cos(half_x), 0.0, math.sin(half_x), 0.0)),
            WHEEL_Y: Pose(self._wheel_y, (math.cos(half_y), math.sin(half_y), 0.0, 0.0)),
        }

    def at(self, position: Pair, psi: Pair) -> dict[str, Transform]:
        """Return the pose of every frame in its parent for the ball's position [m] and pitch [rad].

        Both are in plane signs.
        """
        poses = self.moving(position, psi) | self.fixed
        return {frame: Transform.of(pose) for frame, pose in poses.items()}


def poses_in_map(frames: dict[str, Transform]) -> dict[str, Transform]:
    """Return every frame of :meth:`Frames.at` in ``map``."""
    body = frames[BODY]
    return {frame: pose if frame == BODY else body.compose(pose) for frame, pose in frames.items()}
