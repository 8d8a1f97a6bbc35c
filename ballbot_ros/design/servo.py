"""The servo controller of section 4.2: gains and closed-loop poles."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ballbot_ros.design.state_feedback import lqr
from ballbot_ros.plant.model import Matrix, PhysicalParameters, state_space

DEGREE = math.pi / 180.0
Q_DIAGONAL = (1.0, 6e5, 1.0, 1.0, 1e3)
R_WEIGHT = 6e3 * (180.0 / math.pi) ** 2
PUBLISHED_GAIN = (-0.015, -1.5698, -0.027, -0.2325, -0.0071)


@dataclass(frozen=True)
class ServoDesign:
    """A servo controller.

    Attributes
    ----------
    gain : ndarray, shape (5,)
        k_f for theta, psi, theta_dot, psi_dot, then k_i.
    poles : ndarray of complex, shape (5,)
        Closed-loop poles [1/s].
    """

    gain: Matrix
    poles: NDArray[np.complex128]


def degree_state_space(p: PhysicalParameters) -> tuple[Matrix, Matrix]:
    """Return A (4, 4) and B (4, 1) of (3.24) with angles in degrees: only alpha is scaled."""
    a, b = state_space(p)
    return a, b[:, :1] / DEGREE


def design_servo(
    p: PhysicalParameters,
    q_diagonal: Sequence[float] = Q_DIAGONAL,
    r: float = R_WEIGHT,
) -> ServoDesign:
    """Compute the servo gains by LQR on the plant with the integral of theta (A.9).

    Raises
    ------
    DesignError
        If the extended plant is not controllable or the weights admit no solution.
    """
    a, b = degree_state_space(p)
    a_bar = np.zeros((5, 5))
    a_bar[:4, :4] = a
    a_bar[4, 0] = 1.0
    b_bar = np.vstack([b, [[0.0]]])
    gain = lqr(a_bar, b_bar, np.diag(q_diagonal), [[r]])
    return ServoDesign(
        gain=gain[0],
        poles=np.linalg.eigvals(a_bar - b_bar @ gain).astype(complex),
    )
