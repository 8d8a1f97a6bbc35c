"""State feedback for a controllable system (Appendix A.2)."""

from __future__ import annotations

from collections.abc import Sequence

import control
import numpy as np
from numpy.typing import ArrayLike

from ballbot_ros.errors import BallbotError
from ballbot_ros.plant.model import Matrix


class DesignError(BallbotError):
    """A system or weight for which no controller exists."""


def require_controllable(a: ArrayLike, b: ArrayLike) -> None:
    """Raise DesignError unless the pair (A, B) is controllable.

    By Hautus' test, [A - sI, B] has full rank at every pole s of A. Unlike the rank of the
    controllability matrix (A.5), this test tolerates rounding even for a stiff system.
    """
    a, b = np.asarray(a, float), np.asarray(b, float)
    if a.ndim != 2 or a.shape[0] != a.shape[1] or b.shape[:1] != a.shape[:1]:
        raise DesignError(f'A must be square, with as many rows as B: got A {a.shape}, B {b.shape}')
    if not (np.isfinite(a).all() and np.isfinite(b).all()):
        raise DesignError('A and B must be finite')
    inputs = b * (np.linalg.norm(a) or 1.0) / (np.linalg.norm(b) or 1.0)
    for pole in np.linalg.eigvals(a):
        rank = np.linalg.matrix_rank(np.hstack([a - pole * np.eye(len(a)), inputs]))
        if rank < len(a):
            raise DesignError(
                f'the system is not controllable: no input reaches its pole {complex(pole):.4g} 1/s'
            )


def require_weights(q: ArrayLike, r: ArrayLike) -> None:
    """Raise DesignError unless the weights Q and R are possible: Q ≥ 0, R > 0."""
    for name, weight, least in (('Q', q, 0.0), ('R', r, np.finfo(float).tiny)):
        if not (np.linalg.eigvalsh(np.nan_to_num(weight, nan=-1.0)) >= least).all():
            raise DesignError(f'no linear quadratic regulator: {name} must not be negative')


def lqr(a: ArrayLike, b: ArrayLike, q: ArrayLike, r: ArrayLike) -> Matrix:
    """Return the gain K (m, n) that minimises the integral of x'Qx + u'Ru.

    Raises
    ------
    DesignError
        If (A, B) is not controllable, or the weights admit no solution.
    """
    require_controllable(a, b)
    require_weights(q, r)
    try:
        gain, _, _ = control.lqr(a, b, q, r)
    except (control.ControlArgument, ValueError, np.linalg.LinAlgError) as error:
        raise DesignError(f'no linear quadratic regulator: {error}') from None
    return np.asarray(gain, float)


def place(a: ArrayLike, b: ArrayLike, poles: Sequence[complex]) -> Matrix:
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
        raise DesignError(f'the poles cannot be placed: {error}') from None
