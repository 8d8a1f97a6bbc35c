"""The covariance that white noise gives a stable discrete system."""

from __future__ import annotations

import numpy as np

from ballbot_ros.plant.model import Matrix

FADED = 1e-30
"""Part of a motion below which nothing is left of it."""


def steady_covariance(a: Matrix, noise: Matrix) -> Matrix:
    """Return the covariance (n, n) of the states of ``x[k+1] = a x[k] + w[k]``.

    It is the sum of ``a^k noise a'^k`` over all k, found by doubling their number: the states of a
    loop differ by orders of magnitude, and a solver of Lyapunov's equation loses digits with them.

    Parameters
    ----------
    a : ndarray, shape (n, n)
        A stable transition.
    noise : ndarray, shape (n, n)
        The covariance of w.
    """
    power, covariance = a, noise
    while np.abs(power).max() > FADED:
        covariance = covariance + power @ covariance @ power.T
        power = power @ power
    return covariance
