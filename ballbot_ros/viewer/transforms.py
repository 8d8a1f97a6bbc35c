"""The frame tree and all poses in it, shared by URDF, transforms and markers."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ballbot_ros.parameters import Dimensions
from ballbot_ros.recording.messages.conversions import body_orientation
from ballbot_ros.recording.messages.tool_messages import FOOTPRINT, ODOM_FRAME, FramePose
from ballbot_ros.robot.plant.ground_truth import Pair
from ballbot_ros.viewer.robot import (
    BALL,
    BODY,
    WHEEL_X,
    WHEEL_Y,
    sonar_position,
    wheel_angles,
    wheel_centres,
)

if TYPE_CHECKING:
    from scipy.spatial.transform import Rotation

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
