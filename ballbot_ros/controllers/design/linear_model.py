"""The linear model of one plane, state feedback, and the servo of section 4.2."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import control
import numpy as np
from numpy.typing import ArrayLike, NDArray

from ballbot_ros.errors import BallbotError
from ballbot_ros.parameters import ControllerParameters, ParameterSet, PlantParameters
from ballbot_ros.robot.plant.model import Matrix, PhysicalParameters, state_space


class DesignError(BallbotError):
    """A system or weight for which no controller exists."""


def _require_controllable(a: ArrayLike, b: ArrayLike) -> None:
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

    It raises DesignError if (A, B) is not controllable, or the weights admit no solution.
    """
    _require_controllable(a, b)
    require_weights(q, r)
    try:
        gain, _, _ = control.lqr(a, b, q, r)
    except (control.ControlArgument, ValueError, np.linalg.LinAlgError) as error:
        raise DesignError(f'no linear quadratic regulator: {error}') from None
    return np.asarray(gain, float)


STATES = ('theta', 'psi', 'theta_dot', 'psi_dot')

_DEGREES_PER_RADIAN = 180.0 / np.pi


def plane_model(p: PhysicalParameters) -> control.StateSpace:
    """Return (3.24) of one plane: motor voltage `v` [V] to its states [rad, rad/s]."""
    a, b = state_space(p)
    return control.ss(
        a, b[:, :1], np.eye(4), 0.0, inputs=['v'], outputs=STATES, states=STATES, name='plane'
    )


def ideal_loop(parameters: ParameterSet) -> control.StateSpace:
    """Return the loop of section 4.2, opened at the motor voltage: `v` to `v_fb` [V].

    State feedback in continuous time with the gains in use: ``k_f`` on the states, ``k_i`` on the
    integral of theta, both times ``pwm_gain``. Without ``k_i`` there is no integral.
    """
    own = parameters.of(ControllerParameters)
    a, b = state_space(PhysicalParameters.from_parameters(parameters.of(PlantParameters)))
    a_bar = np.zeros((5, 5))
    a_bar[:4, :4] = a
    a_bar[4, 0] = 1.0
    b_bar = np.vstack([b[:, :1], [[0.0]]])
    c = own.pwm_gain * np.array([[*own.k_f, own.k_i]]) * _DEGREES_PER_RADIAN
    states = (*STATES, 'theta_integral')
    n = 5 if own.k_i else 4
    return control.ss(
        a_bar[:n, :n], b_bar[:n], c[:, :n], 0.0,
        inputs=['v'], outputs=['v_fb'], states=states[:n], name='loop',
    )  # fmt: skip


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
    p: PhysicalParameters, q_diagonal: Sequence[float] = Q_DIAGONAL, r: float = R_WEIGHT
) -> ServoDesign:
    """Compute the servo gains by LQR on the plant with the integral of theta (A.9).

    Its error is that of :func:`lqr` for the extended plant.
    """
    a, b = degree_state_space(p)
    a_bar = np.zeros((5, 5))
    a_bar[:4, :4] = a
    a_bar[4, 0] = 1.0
    b_bar = np.vstack([b, [[0.0]]])
    gain = lqr(a_bar, b_bar, np.diag(q_diagonal), [[r]])
    return ServoDesign(gain=gain[0], poles=np.linalg.eigvals(a_bar - b_bar @ gain).astype(complex))
