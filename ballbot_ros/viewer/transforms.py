"""The frame tree and all poses in it, shared by URDF, transforms and markers."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ballbot_ros.messages.conversions import body_orientation
from ballbot_ros.parameters import Dimensions
from ballbot_ros.plant.truth import Pair
from ballbot_ros.viewer.robot import (
    BALL,
    BODY,
    WHEEL_X,
    WHEEL_Y,
    RollingOrientation,
    Vector,
    product,
    rotate,
    sonar_position,
    wheel_centres,
)

MAP, SONAR = 'map', 'sonar'

PARENTS = {BODY: MAP, BALL: BODY, WHEEL_X: BODY, WHEEL_Y: BODY, SONAR: BODY}
"""The parent of each frame."""

MOVING = (BODY, BALL, WHEEL_X, WHEEL_Y)
"""The frames that move in their parents; the others are fixed."""

_NO_TURN = (1.0, 0.0, 0.0, 0.0)


class Transform(NamedTuple):
    """The pose of a frame in another one, or the poses of many objects.

    Attributes
    ----------
    position : ndarray
        Shape (3,) or (n, 3) [m].
    turn : ndarray
        Unit quaternion w, x, y, z; shape (4,) or (n, 4).
    """

    position: NDArray[np.float64]
    turn: NDArray[np.float64]

    def place(self, inner: Transform) -> Transform:
        """Return the pose in the outer frame of an object at `inner` in this frame."""
        return Transform(
            self.position + rotate(self.turn, inner.position), product(self.turn, inner.turn)
        )


def turn_of(angles: Vector) -> NDArray[np.float64]:
    """Return the quaternion of roll, pitch and yaw as in URDF [rad]: about x, then y, then z."""
    turn = np.array(_NO_TURN)
    for axis, angle in enumerate(angles):
        step = np.zeros(4)
        step[0], step[axis + 1] = np.cos(angle / 2.0), np.sin(angle / 2.0)
        turn = product(step, turn)
    return turn


class Frames:
    """Poses of the frames in their parents.

    ``base_link`` and ``ball`` have their origin in the ball's centre. The axes of ``ball`` stay
    parallel to those of ``map`` (docs/frames.md), so in ``base_link`` it rotates opposite to the
    pitch.

    Parameters
    ----------
    dimensions : Dimensions
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
        body = np.array(body_orientation(psi))
        wheel_x, wheel_y = self._orientation.wheels(position, psi)
        turns = {
            BALL: body * (1.0, -1.0, -1.0, -1.0),
            WHEEL_X: np.array(wheel_x),
            WHEEL_Y: np.array(wheel_y),
            SONAR: np.array(_NO_TURN),
        }
        centre = np.array([position[0], -position[1], self._height])
        return {BODY: Transform(centre, body)} | {
            frame: Transform(self._origins[frame], turn) for frame, turn in turns.items()
        }


def in_map(frames: dict[str, Transform]) -> dict[str, Transform]:
    """Return every frame of :meth:`Frames.at` in ``map``."""
    body = frames[BODY]
    return {frame: place if frame == BODY else body.place(place) for frame, place in frames.items()}
