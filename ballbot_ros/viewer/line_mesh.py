"""The black lines of the floor as a mesh with a smooth outline."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array

from ballbot_ros.viewer.shapes import Mesh
from ballbot_ros.world.floor_map import CELL_M, LINE, FloorMap

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
