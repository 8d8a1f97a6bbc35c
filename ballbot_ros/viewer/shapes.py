"""Objects in the scene: meshes, the lines of the floor, trails and arrows."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.spatial.transform import Rotation
from viser import LineSegmentsHandle, SceneApi

from ballbot_ros.robot.plant.ground_truth import Pair
from ballbot_ros.robot.world.floor_map import CELL_M, LINE, FloorMap
from ballbot_ros.viewer import robot as colours
from ballbot_ros.viewer.markers import Rectangle
from ballbot_ros.viewer.robot import Colour, Part
from ballbot_ros.viewer.snapshot import TRAIL_PIECE

Mesh = tuple[NDArray[np.float64], NDArray[np.int64]]
"""Vertices, shape (n, 3), and faces, shape (m, 3)."""

_SIDES = 32


def link_meshes(parts: Iterable[Part]) -> dict[tuple[str, Colour], Mesh]:
    """Return one mesh per link and colour: fewer meshes render faster."""
    pieces: dict[tuple[str, Colour], list[Any]] = defaultdict(list)
    for part in parts:
        mesh = _primitive(part)
        rotation = Rotation.from_euler('xyz', part.rpy)
        mesh.vertices = rotation.apply(mesh.vertices) + part.position
        pieces[part.link, part.colour].append(mesh)
    return {key: _mesh(trimesh.util.concatenate(meshes)) for key, meshes in pieces.items()}


def _primitive(part: Part) -> Any:
    if part.shape == 'box':
        return trimesh.creation.box(part.size)
    if part.shape == 'cylinder':
        return trimesh.creation.cylinder(part.size[0], part.size[1], sections=_SIDES)
    return trimesh.creation.icosphere(3, part.size[0])


def ball_sectors(radius: float) -> tuple[Mesh, Mesh]:
    """Return a ball as eight sectors in two alternating meshes, which make its rolling visible."""
    mesh = trimesh.creation.icosphere(4, radius)
    middles = mesh.triangles_center
    octant = (middles > 0.0).sum(axis=1) % 2 == 0
    whole = _mesh(mesh)
    return (whole[0], whole[1][octant]), (whole[0], whole[1][~octant])


def prisms(rectangles: Sequence[Rectangle], low: float, high: float) -> Mesh:
    """Return blocks on rectangles, from `low` to `high` [m]."""
    boxes = []
    for left, bottom, right, top in rectangles:
        box = trimesh.creation.box((right - left, top - bottom, high - low))
        box.apply_translation(((left + right) / 2, (bottom + top) / 2, (low + high) / 2))
        boxes.append(box)
    return _mesh(trimesh.util.concatenate(boxes))


def unit_cone() -> Mesh:
    """Return a cone of length and radius 1 m along +x with its tip in the origin."""
    mesh = trimesh.creation.cone(1.0, 1.0, sections=_SIDES)
    # trimesh puts the base at the origin: move the tip there, and turn the axis to +x.
    mesh.vertices = Rotation.from_euler('y', -np.pi / 2.0).apply(mesh.vertices - (0.0, 0.0, 1.0))
    return _mesh(mesh)


def flat_arrow() -> Mesh:
    """Return an arrow on the floor from the origin to x = 1 m, half as wide at its head."""
    back, neck, shaft, head = 0.0, 0.45, 0.09, 0.25
    outline = [(back, -shaft), (neck, -shaft), (neck, shaft), (back, shaft)]
    outline += [(neck, -head), (1.0, 0.0), (neck, head)]
    vertices = np.array([(x, y, 0.0) for x, y in outline])
    return vertices, np.array([(0, 1, 2), (0, 2, 3), (4, 5, 6)])


def _mesh(mesh: Any) -> Mesh:
    return np.asarray(mesh.vertices, np.float64), np.asarray(mesh.faces, np.int64)


Edges = tuple[NDArray[np.int64], NDArray[np.int64]]
"""Numbers of the corners at both ends of each edge."""

_PASSES = 100
_MAX_SHIFT = 0.45
"""How far a corner of the outline moves along x and y, in cells: the centre of each cell keeps its
colour."""


def line_mesh(floor_map: FloorMap) -> Mesh | None:
    """Return the lines as a flat mesh at height 0 in ``map`` [m]; None if there are none.

    The mesh has the cells of the lines as its quadrangles. The corners on the outline move towards
    the mean of their neighbours, which turns the steps of the cells into straight lines and curves.
    """
    mask = np.equal(floor_map.cells, LINE)
    if not mask.any():
        return None
    rows, columns = mask.shape
    corners = np.indices((rows + 1, columns + 1)).reshape(2, -1).T.astype(np.float64)
    row, column = _smooth(corners, _outline(mask)).T
    vertices = np.column_stack(
        [(column - columns / 2.0) * CELL_M, (rows / 2.0 - row) * CELL_M, np.zeros(len(row))]
    )
    faces = _faces(mask)
    used, places = np.unique(faces, return_inverse=True)
    return vertices[used], places.reshape(faces.shape)


def _outline(mask: NDArray[np.bool_]) -> Edges:
    """Return the sides of cells at which the lines end."""
    padded = np.pad(mask, 1)
    width = mask.shape[1] + 1
    row, column = np.nonzero(padded[1:, 1:-1] != padded[:-1, 1:-1])
    left = row * width + column
    row, column = np.nonzero(padded[1:-1, 1:] != padded[1:-1, :-1])
    top = row * width + column
    return np.concatenate([left, top]), np.concatenate([left + 1, top + width])


def _smooth(corners: NDArray[np.float64], outline: Edges) -> NDArray[np.float64]:
    """Return the corners after those that are part of steps have moved.

    A corner between two sides longer than one cell is no step: it stays, and so do those at which
    two lines meet diagonally.
    """
    start, end = outline
    size = len(corners)
    neighbours = coo_array(
        (np.ones(2 * len(start)), (np.r_[start, end], np.r_[end, start])), shape=(size, size)
    ).tocsr()
    is_simple = np.bincount(np.r_[start, end], minlength=size) == 2
    is_straight = is_simple & (neighbours @ corners == 2.0 * corners).all(axis=1)
    moves = np.flatnonzero(is_simple & (is_straight | (neighbours @ is_straight < 2.0)))
    neighbours, still = neighbours[moves], corners[moves]
    corners = corners.copy()
    for _ in range(_PASSES):
        middle = (corners[moves] + neighbours @ corners / 2.0) / 2.0
        corners[moves] = still + (middle - still).clip(-_MAX_SHIFT, _MAX_SHIFT)
    return corners


def _faces(mask: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Return two triangles for each cell of the lines, seen anticlockwise from above."""
    width = mask.shape[1] + 1
    row, column = np.nonzero(mask)
    left = row * width + column
    right, low_left, low_right = left + 1, left + width, left + width + 1
    return np.column_stack([left, low_left, low_right, left, low_right, right]).reshape(-1, 3)


_THICKNESS = 0.006

Points = list[tuple[float, float]]
"""Points of a trail, x and y in ``map`` [m]."""


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
        # Each piece begins with the last point of the one before.
        starts = range(0, len(points) - 1, TRAIL_PIECE)
        pieces = [points[start : start + TRAIL_PIECE + 1] for start in starts]
        for number, piece in enumerate(pieces):
            if number == len(self._lines):
                self._lines.append(self._add_line(number))
                self._sent.append([])
            if self._sent[number] != piece:
                self._sent[number] = piece
                points_3d = np.array([(x, y, self._height) for x, y in piece], np.float32)
                self._lines[number].points = np.stack([points_3d[:-1], points_3d[1:]], axis=1)
        for number, line in enumerate(self._lines):
            if line.visible != (number < len(pieces)):
                line.visible = number < len(pieces)

    def _add_line(self, number: int) -> LineSegmentsHandle:
        return self._api.add_line_segments(
            f'{self._path}/{number}', np.zeros((0, 2, 3)), self._colour, thickness=_THICKNESS
        )


NEWTONS_PER_METRE = 10.0
"""Force per length of its arrow."""

_SHAFT, _HEAD, _HEAD_LENGTH = 0.006, 0.016, 0.04
"""Radius of shaft and head, and length of the head [m]."""

Point = Sequence[float] | NDArray[np.float64]
"""x, y, z in ``map`` [m]."""


class ForceArrow:
    """The arrow of a force, hidden until it is shown; `with_size`: with its size in newtons."""

    def __init__(self, api: SceneApi, name: str, *, with_size: bool) -> None:
        self._arrow = api.add_arrows(
            f'/{name}', np.zeros((1, 2, 3)), colours.FORCE, shaft_radius=_SHAFT, head_radius=_HEAD,
            head_length=_HEAD_LENGTH, visible=False,
        )  # fmt: skip
        label = f'/{name}/label'
        self._label = api.add_label(label, '', anchor='bottom-center') if with_size else None

    def show(self, origin: Point, force: Pair) -> None:
        """Show a force in plane signs [N] at a point in ``map`` [m]."""
        vector = force[0] / NEWTONS_PER_METRE, -force[1] / NEWTONS_PER_METRE, 0.0
        end = np.add(origin, vector)
        self._arrow.head_length = min(_HEAD_LENGTH, float(np.linalg.norm(vector)))
        self._arrow.points = np.array([[origin, end]], np.float32)
        self._arrow.visible = True
        if self._label is not None:
            self._label.position = end
            self._label.text = f'{math.hypot(*force):.1f} N'

    def hide(self) -> None:
        """Hide the arrow."""
        self._arrow.visible = False
