"""Meshes of primitives and floors."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from ballbot_ros.viewer.colours import Colour
from ballbot_ros.viewer.floor import Rectangle
from ballbot_ros.viewer.robot import Part

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
