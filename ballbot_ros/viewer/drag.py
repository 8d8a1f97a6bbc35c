"""Pushing the robot by dragging it."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray
from viser import SceneNodeDragEvent

from ballbot_ros.plant.ground_truth import Pair
from ballbot_ros.viewer.arrows import NEWTONS_PER_METRE, ForceArrow, Point

MIN_FORCE, MAX_FORCE = 0.1, 3.0
"""Smallest and largest force that a page can apply [N]."""

_STEEP = math.sin(math.radians(12.0))
"""Slope from which a line of sight meets the horizontal plane near enough."""


def drag_vector(eye: Point, grip: Point, pointer: Point) -> NDArray[np.float64]:
    """Return how far a drag pulls the robot horizontally, x, y in ``map`` [m].

    Parameters
    ----------
    eye, grip : sequence of float
        Position of the camera, and of the dragged point.
    pointer : sequence of float
        A point under the pointer, on the plane through `grip` that faces the camera.
    """
    eye, grip, pointer = (np.asarray(point, float) for point in (eye, grip, pointer))
    sight = pointer - eye
    length = float(np.linalg.norm(sight))
    if sight[2] * (grip[2] - eye[2]) > 0.0 and abs(sight[2]) > _STEEP * length:
        pointer = eye + sight * ((grip[2] - eye[2]) / sight[2])
    pull: NDArray[np.float64] = (pointer - grip)[:2]
    return pull


def drag_force(eye: Point, grip: Point, pointer: Point) -> Pair:
    """Return the force of a drag in plane signs [N], at most :data:`MAX_FORCE`.

    The points are as in :func:`drag_vector`.
    """
    with np.errstate(all='ignore'):  # a page may send any numbers
        force = NEWTONS_PER_METRE * drag_vector(eye, grip, pointer)
        size = float(np.linalg.norm(force))
    if not math.isfinite(size):
        return 0.0, 0.0
    x, y = (force * min(1.0, MAX_FORCE / size) if size else force).tolist()
    return x, -y


class DragPush:
    """Shows the force while a page drags the robot, and applies it at the release.

    Parameters
    ----------
    arrow : ForceArrow
        Shows the force.
    push : callable
        Pushes the robot with a force in plane signs [N].
    """

    def __init__(self, arrow: ForceArrow, push: Callable[[Pair], None]) -> None:
        self._arrow, self._push = arrow, push

    # A coroutine, which viser calls in the order of the events.
    async def on_drag(self, event: SceneNodeDragEvent[Any]) -> None:
        """Process a drag event of viser."""
        grip = event.start_position
        force = drag_force(event.client.camera.position, grip, event.end_position)
        if event.phase != 'end':
            self._arrow.show(grip, force)
            return
        self._arrow.hide()
        if math.hypot(*force) >= MIN_FORCE:
            self._push(force)
