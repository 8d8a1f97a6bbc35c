"""Lines on which a field on a grid has a value."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Lines = list[Floats]
"""Each (n, 2): x and y of its points."""


_STEP = 1e-6
"""Width of a step, as a part of the distance between its values."""


def contour_lines(
    x: Floats, y: Floats, values: Floats, level: float, stepped: tuple[bool, bool] = (False, False)
) -> Lines:
    """Return the lines of a level; they end where the field is NaN.

    Parameters
    ----------
    x, y : ndarray, shapes (n,) and (m,)
        Ascending coordinates of the grid.
    values : ndarray, shape (m, n)
        The field.
    stepped : tuple of bool
        Whether nothing lies between the coordinates x, and y, such as between whole numbers. There
        the lines run in the middle.
    """
    from matplotlib.figure import Figure

    known = values[~np.isnan(values)]
    if min(values.shape) < 2 or not known.size or not known.min() < level < known.max():
        return []
    if stepped[0]:
        x, values = _steps(x), np.repeat(values, 2, axis=1)
    if stepped[1]:
        y, values = _steps(y), np.repeat(values, 2, axis=0)
    found = Figure().subplots().contour(x, y, np.ma.masked_invalid(values), levels=[level])
    return [np.asarray(line, float) for line in found.allsegs[0] if len(line) > 1]


def _steps(axis: Floats) -> Floats:
    """Return both ends of the interval around each coordinate, shape (2n,)."""
    middles = (axis[1:] + axis[:-1]) / 2.0
    first, last = 2.0 * axis[0] - middles[0], 2.0 * axis[-1] - middles[-1]
    lows, highs = np.append(first, middles), np.append(middles, last)
    gap = _STEP * (highs - lows)
    return np.column_stack([lows + gap, highs - gap]).ravel()
