"""Walls, robot and trail as markers in ``map``, for tools without transforms."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from ballbot_ros.parameters import Dimensions
from ballbot_ros.parameters.timing import SECOND_NS
from ballbot_ros.recording.messages.tool_messages import (
    ADD,
    DELETE,
    DELETE_ALL,
    fill_marker,
    fill_points,
    place_marker,
)
from ballbot_ros.robot.world.floor_map import CELL_M, WALL_HEIGHT_CM, FloorMap
from ballbot_ros.viewer import robot as colours
from ballbot_ros.viewer.robot import (
    BODY,
    LINKS,
    SONAR,
    TRAIL_STEP,
    Transform,
    Vector,
    cone_slope,
    parts,
)
from ballbot_ros.viewer.snapshot import Snapshot

FREE_HALF_SIDE = 1.0
"""Half the side of the square shown of an unlimited floor [m]."""

Rectangle = tuple[float, float, float, float]
"""Lowest x and y, highest x and y in ``map`` [m]."""


@dataclass(frozen=True)
class Area:
    """Centre and half sides of the part of the floor in the fixed views [m]."""

    middle: tuple[float, float]
    half_x: float
    half_y: float

    @classmethod
    def of(cls, floor_map: FloorMap | None, start: tuple[float, float] = (0.0, 0.0)) -> Area:
        """Return the map, or a square around `start` (x, y in ``map``) on an unlimited floor."""
        if floor_map is None:
            return cls(start, FREE_HALF_SIDE, FREE_HALF_SIDE)
        return cls((0.0, 0.0), floor_map.columns * CELL_M / 2, floor_map.rows * CELL_M / 2)


def walls(floor_map: FloorMap) -> list[Rectangle]:
    """Return the walls as rectangles that do not overlap: equal runs of cells in rows."""
    rectangles: list[Rectangle] = []
    mask = floor_map.walls
    open_runs: dict[tuple[int, int], int] = {}
    blank = np.zeros((1, mask.shape[1]), bool)
    for row, cells in enumerate(np.vstack([mask, blank])):
        edges = np.flatnonzero(np.diff(cells, prepend=False, append=False))
        runs = set(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))
        for run in [run for run in open_runs if run not in runs]:
            first = open_runs.pop(run)
            left, right = ((edge - floor_map.columns / 2.0) * CELL_M for edge in run)
            bottom, top = ((floor_map.rows / 2.0 - edge) * CELL_M for edge in (row, first))
            rectangles.append((left, bottom, right, top))
        for run in runs:
            open_runs.setdefault(run, row)
    return rectangles


TRAIL_POINTS = 500
"""Maximum length of the trail: 5 m."""

_TRAIL_WIDTH, _TRAIL_HEIGHT = 0.006, 0.002
_LETTER_HEIGHT = 0.022
_TEXT_ABOVE = 0.16
_BEAM_SIDES = 12


def floor_markers(floor: FloorMap | None, new_marker: Callable[[], Any]) -> list[Any]:
    """Return a marker that deletes all others, and the walls, if there are any.

    `new_marker` creates an empty ``visualization_msgs/Marker``.
    """
    erase = new_marker()
    erase.action = DELETE_ALL
    markers = [erase]
    height = WALL_HEIGHT_CM / 100.0
    for number, (left, bottom, right, top) in enumerate(walls(floor) if floor else ()):
        size = right - left, top - bottom, height
        wall = fill_marker(new_marker(), 'walls', number, 'box', size, colours.WALL)
        place_marker(wall, 0, ((left + right) / 2.0, (bottom + top) / 2.0, height / 2.0))
        markers.append(wall)
    return markers


class RobotMarkers:
    """Creates the markers that have changed; each keeps its namespace and number.

    The namespaces are the links, ``sonar``, ``trail``, ``text`` and ``walls``. `new_marker` creates
    an empty ``visualization_msgs/Marker``.
    """

    def __init__(self, dimensions: Dimensions, new_marker: Callable[[], Any]) -> None:
        from scipy.spatial.transform import Rotation

        self._new_marker = new_marker
        self._links: dict[str, tuple[list[Any], Transform]] = {}
        for link in LINKS:
            pieces = [part for part in parts(dimensions) if part.link == link]
            if pieces:  # not those of a wheel without width
                markers = [
                    fill_marker(new_marker(), link, number, part.shape, part.size, part.colour)
                    for number, part in enumerate(pieces)
                ]
                poses = Transform(
                    np.array([part.position for part in pieces]),
                    Rotation.from_euler('xyz', [part.rpy for part in pieces]),
                )
                self._links[link] = markers, poses
        self._beam = fill_marker(
            new_marker(), SONAR, 0, 'triangles', (), colours.BEAM, colours.BEAM_OPACITY
        )
        width, height = (_TRAIL_WIDTH,), (_LETTER_HEIGHT,)
        self._trail = fill_marker(new_marker(), 'trail', 0, 'line', width, colours.TRAIL)
        self._text = fill_marker(new_marker(), 'text', 0, 'text', height, colours.WHITE)
        self._text_height = 2.0 * dimensions.body_height + _TEXT_ABOVE
        self._trail_points: deque[Vector] = deque(maxlen=TRAIL_POINTS)
        self.begin(None)

    def begin(self, floor: FloorMap | None) -> None:
        """Start over with a new run, on a floor with or without walls."""
        self._trail_points.clear()
        self._erase, *self._walls = floor_markers(floor, self._new_marker)
        self._is_new = self._is_longer = True

    def follow(self, snapshot: Snapshot) -> None:
        """Extend the trail."""
        point = (snapshot.position[0], -snapshot.position[1], _TRAIL_HEIGHT)
        if not self._trail_points or math.dist(point, self._trail_points[-1]) >= TRAIL_STEP:
            self._trail_points.append(point)
            self._is_longer = True

    def at(self, snapshot: Snapshot, poses: dict[str, Transform], *, whole: bool) -> list[Any]:
        """Return the changed markers or, if `whole`, all, for the frames' poses in ``map``.

        They are the same objects each time, updated; at the start of a run, the first one deletes
        all.
        """
        stamp_ns = round(snapshot.time * SECOND_NS)
        markers = [self._erase] if self._is_new else []
        for link, (pieces, local) in self._links.items():
            for piece, *pose in zip(pieces, *poses[link].compose(local).values(), strict=True):
                place_marker(piece, stamp_ns, *pose)
            markers += pieces
        self._show_beam(stamp_ns, snapshot, poses[SONAR])
        self._show_text(stamp_ns, snapshot, poses[BODY])
        markers += [self._beam, self._text]
        if self._is_new or whole:
            markers += self._walls
        if self._is_longer or whole:
            self._show_trail(stamp_ns)
            markers.append(self._trail)
        self._is_new = self._is_longer = False
        return markers

    def _show_beam(self, stamp_ns: int, snapshot: Snapshot, sensor: Transform) -> None:
        """Show the sonar's cone up to the measured distance; hide it without an echo."""
        reach = snapshot.sonar
        place_marker(self._beam, stamp_ns, *sensor.values())
        self._beam.action = ADD if math.isfinite(reach) and reach > 0.0 else DELETE
        if self._beam.action == ADD:
            radius = reach * cone_slope(snapshot.cone_angle)
            angles = [2.0 * math.pi * side / _BEAM_SIDES for side in range(_BEAM_SIDES + 1)]
            rim = [(reach, radius * math.cos(a), radius * math.sin(a)) for a in angles]
            tip = (0.0, 0.0, 0.0)
            fill_points(self._beam, (point for a, b in pairwise(rim) for point in (tip, a, b)))

    def _show_text(self, stamp_ns: int, snapshot: Snapshot, body: Transform) -> None:
        """Show operating state and display above the robot."""
        lines = [snapshot.state, *snapshot.lcd.split('\n')]
        self._text.text = '\n'.join(line.rstrip() for line in lines if line.strip())
        self._text.action = ADD if self._text.text else DELETE
        x, y, z = body.position.tolist()
        place_marker(self._text, stamp_ns, (x, y, z + self._text_height))

    def _show_trail(self, stamp_ns: int) -> None:
        """Show the trail of the ball; a line needs two points."""
        self._trail.action = ADD if len(self._trail_points) > 1 else DELETE
        fill_points(self._trail, self._trail_points)
        place_marker(self._trail, stamp_ns, (0.0, 0.0, 0.0))
