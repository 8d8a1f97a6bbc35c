"""Equations of motion of one plane: the spherical wheeled inverted pendulum (section 3).

The state of a plane is (theta, psi, theta_dot, psi_dot) in rad and rad/s: ball angle and body
pitch. The input is the motor voltage v. Arguments are SI throughout.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ballbot_ros.numerics.elementary import sine_cosine
from ballbot_ros.parameters import Subset

Matrix = NDArray[np.float64]


@dataclass(frozen=True)
class Bodies(Subset):
    """Ball, wheels and body of section 3.1, named as in `parameters.TABLE`."""

    ball_mass: float
    ball_radius: float
    wheel_mass: float
    wheel_radius: float
    wheel_width: float
    body_mass: float
    body_height: float

    @property
    def ball_inertia(self) -> float:
        """Js = 2 Ms Rs²/3 [kg·m²], a hollow sphere."""
        return 2.0 * self.ball_mass * self.ball_radius * self.ball_radius / 3.0

    @property
    def wheel_inertia(self) -> float:
        """Jw = Mw Lw²/2 [kg·m²], the document's formula."""
        return self.wheel_mass * self.wheel_width * self.wheel_width / 2.0

    @property
    def body_inertia(self) -> float:
        """Jpsi = Mb L²/3 [kg·m²]."""
        return self.body_mass * self.body_height * self.body_height / 3.0


@dataclass(frozen=True)
class PhysicalParameters(Bodies):
    """The bodies, their drive and their friction: all of section 3.1."""

    gravity: float
    motor_inertia: float
    motor_resistance: float
    back_emf_constant: float
    torque_constant: float
    motor_friction: float
    ball_friction: float

    @property
    def ratio(self) -> float:
        """Gear ratio k = Rs/Rw from ball to motor (no slip)."""
        return self.ball_radius / self.wheel_radius

    @property
    def drive_inertia(self) -> float:
        """k² (Jm + Jw) [kg·m²], motor and wheel seen from the ball."""
        return self.ratio * self.ratio * (self.motor_inertia + self.wheel_inertia)

    @property
    def alpha(self) -> float:
        """Kt/Rm [N·m/V] (3.19). The document has no factor k here, and its gains depend on that."""
        return self.torque_constant / self.motor_resistance

    @property
    def beta(self) -> float:
        """k (Kt Kb/Rm + fm) [N·m·s/rad] (3.19)."""
        return self.ratio * (
            self.torque_constant * self.back_emf_constant / self.motor_resistance
            + self.motor_friction
        )


class MassMatrix(NamedTuple):
    """Mass matrix [kg·m²] of (3.11)-(3.12) at a pitch psi.

    ``[[m11, m12], [m12, m22]]`` with ``m12 = coupling cos(psi) - drive``. Its determinant is
    computed as ``det + cos(psi) (det_1 - det_2 cos(psi))``, with det at least a third larger than
    det_2, because the difference m11 m22 - m12² would lose all digits where the drive's inertia
    dominates.
    """

    m11: float
    m22: float
    coupling: float
    drive: float
    det: float
    det_1: float
    det_2: float

    def determinant(self, cosine: float) -> float:
        """Return the determinant for the cosine of a pitch."""
        return self.det + cosine * (self.det_1 - self.det_2 * cosine)


def mass_matrix(p: PhysicalParameters) -> MassMatrix:
    """Return the mass matrix of a plane."""
    arm = p.body_mass * p.body_height
    coupling = arm * p.ball_radius
    drive = p.drive_inertia
    rolling = (p.body_mass + p.ball_mass) * p.ball_radius * p.ball_radius + p.ball_inertia
    tilting = arm * p.body_height + p.body_inertia
    return MassMatrix(
        m11=rolling + drive,
        m22=tilting + drive,
        coupling=coupling,
        drive=drive,
        det=tilting * rolling + drive * (rolling + tilting),
        det_1=2.0 * drive * coupling,
        det_2=coupling * coupling,
    )


def state_space(p: PhysicalParameters) -> tuple[Matrix, Matrix]:
    """Return A (4, 4) and B (4, 3) of the linear state equation (3.24), angles in rad.

    The columns of B belong to the motor voltage [V] and to generalised forces on theta and psi
    [N·m]. The document has no such forces; its B is the first column.
    """
    m = mass_matrix(p)
    determinant = m.determinant(1.0)
    # The inverse of the mass matrix.
    i11, i22 = m.m22 / determinant, m.m11 / determinant
    i12 = (m.drive - m.coupling) / determinant
    weight = p.body_mass * p.body_height * p.gravity
    beta, friction = p.beta, p.beta + p.ball_friction
    a = np.array(
        [
            [0.0, 0.0, 1.0, 0.0],
            [0.0, 0.0, 0.0, 1.0],
            [0.0, i12 * weight, i12 * beta - i11 * friction, (i11 - i12) * beta],
            [0.0, i22 * weight, i22 * beta - i12 * friction, (i12 - i22) * beta],
        ]
    )
    b = np.array(
        [
            [0.0, 0.0, 0.0],
            [0.0, 0.0, 0.0],
            [(i11 - i12) * p.alpha, i11, i12],
            [(i12 - i22) * p.alpha, i12, i22],
        ]
    )
    return a, b


def impulse_ratio(m: MassMatrix, psi: float) -> float:
    """Return m12/m22 of the mass matrix of (3.11)-(3.12) at a pitch; 0 gives the linear model's.

    An impulse on theta alone changes psi_dot by minus this ratio times the change of theta_dot.
    """
    _, cosine = sine_cosine(psi)
    return (m.coupling * cosine - m.drive) / m.m22
