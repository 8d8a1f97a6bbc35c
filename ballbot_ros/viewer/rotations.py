"""Orientations of body, ball and wheels.

Apart from the shape and the frames of the robot, which recordings need, too: importing scipy's
rotations takes a quarter of a second.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from ballbot_ros.parameters import Dimensions
from ballbot_ros.recording.messages.conversions import body_orientation
from ballbot_ros.robot.plant.ground_truth import Pair
from ballbot_ros.viewer.robot import wheel_angles

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
