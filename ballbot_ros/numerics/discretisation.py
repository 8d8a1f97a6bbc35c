"""Exact discretisation of a linear system with held inputs."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Matrix = NDArray[np.float64]

_TERMS = 18
"""Terms of Taylor's series: at a norm of 1/2, the next one is below 10^-21."""

_MAX_DOUBLINGS = 1100
"""Number of squarings sufficient for any finite norm."""


def zero_order_hold(a: Matrix, b: Matrix, dt: float) -> tuple[Matrix, Matrix]:
    """Return the discrete matrices of x' = A x + B u with u held for `dt` seconds.

    They are the transition (n, n) and the effect of the inputs (n, m). Scaling and squaring are
    applied to exp(M) - I with M = [[A, B], [0, 0]] dt, so that motions much slower than `dt` keep
    all their digits. The products are computed element by element in a fixed order, because those
    of numpy and the ``expm`` of scipy round differently on different processors.
    """
    n, m = b.shape
    # The upper rows of [[A, B], [0, 0]] dt; the lower ones are zero in all that follows.
    block = np.zeros((n, n + m))
    norm = 0.0
    for i in range(n):
        row = 0.0
        for j in range(n):
            block[i, j] = a[i, j] * dt
            row += abs(block[i, j])
        for j in range(m):
            block[i, n + j] = b[i, j] * dt
        norm = max(norm, row)
    doublings, scale = 0, 1.0
    while norm * scale > 0.5 and doublings < _MAX_DOUBLINGS:
        scale *= 0.5
        doublings += 1
    for i in range(n):
        for j in range(n + m):
            block[i, j] *= scale

    # X = exp(M) - I = M (I + M/2 (I + M/3 (I + ...)))
    exp_minus_one = block.copy()
    for term in range(_TERMS, 1, -1):
        exp_minus_one = _scaled_product(block, exp_minus_one, 1.0 / term, 1.0)
    # exp(2M) - I = X X + 2X
    for _ in range(doublings):
        exp_minus_one = _scaled_product(exp_minus_one, exp_minus_one, 1.0, 2.0)

    transition, held = np.zeros((n, n)), np.zeros((n, m))
    for i in range(n):
        for j in range(n):
            transition[i, j] = exp_minus_one[i, j] + (1.0 if i == j else 0.0)
        for j in range(m):
            held[i, j] = exp_minus_one[i, n + j]
    return transition, held


def _scaled_product(left: Matrix, right: Matrix, scale: float, weight: float) -> Matrix:
    """Return left · right · scale + left · weight, of matrices whose lower rows are zero."""
    n, width = left.shape
    product = np.empty((n, width))
    for i in range(n):
        for j in range(width):
            total = 0.0
            for k in range(n):
                total += left[i, k] * right[k, j]
            product[i, j] = total * scale + left[i, j] * weight
    return product
