"""Arrows in the scene."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from viser import SceneApi

from ballbot_ros.plant.ground_truth import Pair
from ballbot_ros.viewer import colours
from ballbot_ros.viewer.colours import Colour

NEWTONS_PER_METRE = 10.0
"""Force per length of its arrow."""

_SHAFT, _HEAD, _HEAD_LENGTH = 0.006, 0.016, 0.04
"""Radius of shaft and head, and length of the head [m]."""

Point = Sequence[float] | NDArray[np.float64]
"""x, y, z in ``map`` [m]."""


class Arrow:
    """An arrow, hidden until it is shown."""

    def __init__(self, api: SceneApi, name: str, colour: Colour) -> None:
        self._arrow = api.add_arrows(
            f'/{name}', np.zeros((1, 2, 3)), colour, shaft_radius=_SHAFT, head_radius=_HEAD,
            head_length=_HEAD_LENGTH, visible=False,
        )  # fmt: skip

    def show(self, origin: Point, vector: Point) -> None:
        """Show the arrow from `origin` along `vector` [m]."""
        length = float(np.linalg.norm(vector))
        self._arrow.head_length = min(_HEAD_LENGTH, length)
        self._arrow.points = np.array([[origin, np.add(origin, vector)]], np.float32)
        self._arrow.visible = True

    def hide(self) -> None:
        """Hide the arrow."""
        self._arrow.visible = False


def force_vector(force: Pair) -> tuple[float, float, float]:
    """Return the vector [m] at which the arrow of a force in plane signs [N] is drawn."""
    return force[0] / NEWTONS_PER_METRE, -force[1] / NEWTONS_PER_METRE, 0.0


class ForceArrow:
    """The arrow of a force, with its size in newtons."""

    def __init__(self, api: SceneApi, name: str) -> None:
        self._arrow = Arrow(api, name, colours.FORCE)
        self._label = api.add_label(f'/{name}/label', '', anchor='bottom-center')

    def show(self, origin: Point, force: Pair) -> None:
        """Show a force in plane signs [N] at a point in ``map`` [m]."""
        vector = force_vector(force)
        self._arrow.show(origin, vector)
        self._label.position = np.add(origin, vector)
        self._label.text = f'{math.hypot(*force):.1f} N'

    def hide(self) -> None:
        """Hide the arrow."""
        self._arrow.hide()
