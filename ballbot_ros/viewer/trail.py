"""The trail of a ball on the floor."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from viser import LineSegmentsHandle, SceneApi

from ballbot_ros.viewer.colours import Colour
from ballbot_ros.viewer.snapshot import TRAIL_PIECE

_THICKNESS = 0.006

Points = list[tuple[float, float]]
"""Points of a trail, x and y in ``map`` [m]."""


def pieces_of(points: Points) -> list[Points]:
    """Return the pieces of a trail; each begins with the last point of the one before."""
    starts = range(0, len(points) - 1, TRAIL_PIECE)
    return [points[start : start + TRAIL_PIECE + 1] for start in starts]


class Trail:
    """A trail in the scene at `path`, replacing one there, at a height above the floor [m]."""

    def __init__(self, api: SceneApi, path: str, colour: Colour, height: float) -> None:
        api.remove_by_name(path)
        api.add_frame(path, show_axes=False)
        self._api = api
        self._path = path
        self._colour = colour
        self._height = height
        self._sent: list[Points] = []
        self._lines: list[LineSegmentsHandle] = []

    def show(self, points: Points) -> None:
        """Show a trail; send only what differs from the one before."""
        pieces = pieces_of(points)
        for number, piece in enumerate(pieces):
            if number == len(self._lines):
                self._lines.append(self._add_line(number))
                self._sent.append([])
            if self._sent[number] != piece:
                self._sent[number] = piece
                self._lines[number].points = self._segments(piece)
        for number, line in enumerate(self._lines):
            if line.visible != (number < len(pieces)):
                line.visible = number < len(pieces)

    def _add_line(self, number: int) -> LineSegmentsHandle:
        return self._api.add_line_segments(
            f'{self._path}/{number}', np.zeros((0, 2, 3)), self._colour, thickness=_THICKNESS
        )

    def _segments(self, piece: Points) -> NDArray[np.float32]:
        points = np.array([(x, y, self._height) for x, y in piece], np.float32)
        return np.stack([points[:-1], points[1:]], axis=1)
