"""Lines on which a field on a grid has a value."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Lines = list[Floats]
"""Each (n, 2): x and y of its points."""


def contour_lines(x: Floats, y: Floats, values: Floats, level: float) -> Lines:
    """Return the lines of a level; they end where the field is NaN.

    Parameters
    ----------
    x, y : ndarray, shapes (n,) and (m,)
        Ascending coordinates of the grid.
    values : ndarray, shape (m, n)
        The field.
    """
    from matplotlib.figure import Figure

    known = values[~np.isnan(values)]
    if min(values.shape) < 2 or not known.size or not known.min() < level < known.max():
        return []
    found = Figure().subplots().contour(x, y, np.ma.masked_invalid(values), levels=[level])
    return [np.asarray(line, float) for line in found.allsegs[0] if len(line) > 1]
