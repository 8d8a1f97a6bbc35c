"""State feedback for a controllable system (Appendix A.2)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import control
import numpy as np

from ballbot_ros.errors import BallbotError
from ballbot_ros.plant.model import Matrix


class DesignError(BallbotError):
    """A system or weight for which no controller exists."""


def controllability_rank(a: Any, b: Any) -> int:
    """Return the rank of the controllability matrix [B, AB, ..., A^(n-1) B] (A.5).

    The states are scaled by a power of two each, which leaves the rank alone and keeps stiff
    systems (this robot's poles span a factor of forty) from losing it to rounding.

    Parameters
    ----------
    a : array_like, shape (n, n)
    b : array_like, shape (n, m)
    """
    matrix = np.asarray(control.ctrb(np.asarray(a, float), np.asarray(b, float)))
    largest = np.abs(matrix).max(axis=0)
    largest[largest == 0.0] = 1.0
    return int(np.linalg.matrix_rank(matrix / 2.0 ** np.round(np.log2(largest))))


def require_controllable(a: Any, b: Any) -> None:
    """Raise DesignError unless the pair (A, B) is controllable."""
    order = np.asarray(a).shape[0]
    rank = controllability_rank(a, b)
    if rank < order:
        raise DesignError(
            f'the system is not controllable: its controllability matrix has rank {rank} of {order}'
        )


def lqr(a: Any, b: Any, q: Any, r: Any) -> Matrix:
    """Return the gain K (m, n) that minimises the integral of x'Qx + u'Ru.

    Raises
    ------
    DesignError
        If (A, B) is not controllable, or the weights admit no solution.
    """
    require_controllable(a, b)
    try:
        gain, _, _ = control.lqr(a, b, q, r)
    except (control.ControlArgument, ValueError, np.linalg.LinAlgError) as error:
        raise DesignError(f'no linear quadratic regulator: {error}') from None
    return np.asarray(gain, float)


def place(a: Any, b: Any, poles: Sequence[complex]) -> Matrix:
    """Return the gain K (m, n) that puts the poles of A - BK at `poles`.

    Raises
    ------
    DesignError
        If (A, B) is not controllable, or the poles can't be placed there.
    """
    require_controllable(a, b)
    try:
        return np.asarray(control.place(a, b, poles), float)
    except (control.ControlArgument, ValueError, np.linalg.LinAlgError) as error:
        raise DesignError(f'the poles can not be placed: {error}') from None
